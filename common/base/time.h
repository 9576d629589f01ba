#pragma once

#include <chrono>
#include <cstdint>

namespace portolan {

/// A point in time as integer nanoseconds: of the camera's clock for frames, of Unix time elsewhere. Never a double.
struct Timestamp {
  int64_t ns = 0;

  static constexpr Timestamp FromSeconds(double seconds) {
    return Timestamp{static_cast<int64_t>(seconds * 1e9 + (seconds < 0 ? -0.5 : 0.5))};
  }
  static Timestamp Now() {
    using namespace std::chrono;
    return Timestamp{duration_cast<nanoseconds>(system_clock::now().time_since_epoch()).count()};
  }

  constexpr double Seconds() const { return static_cast<double>(ns) * 1e-9; }

  friend constexpr bool operator==(Timestamp a, Timestamp b) { return a.ns == b.ns; }
  friend constexpr bool operator!=(Timestamp a, Timestamp b) { return a.ns != b.ns; }
  friend constexpr bool operator<(Timestamp a, Timestamp b) { return a.ns < b.ns; }
  friend constexpr bool operator<=(Timestamp a, Timestamp b) { return a.ns <= b.ns; }
};

/// to - from, in seconds.
constexpr double SecondsBetween(Timestamp from, Timestamp to) {
  return static_cast<double>(to.ns - from.ns) * 1e-9;
}

/// Measures elapsed milliseconds on the monotonic clock from its construction or last Restart().
class Stopwatch {
 public:
  Stopwatch() : start_(std::chrono::steady_clock::now()) {}
  void Restart() { start_ = std::chrono::steady_clock::now(); }
  double Milliseconds() const {
    return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start_).count();
  }

 private:
  std::chrono::steady_clock::time_point start_;
};

}  // namespace portolan
