#pragma once

#include <unistd.h>

#include <chrono>
#include <condition_variable>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "transport/bus.h"

namespace portolan {

/// What tests of the bus share. Deadlines are for failures alone: a passing test never waits them out.
constexpr std::chrono::seconds kTestDeadline(20);

/// A domain that other tests and systems on this machine don't use (with a fair chance): by process id, 100 to 229.
inline int TestDomain() {
  return 100 + static_cast<int>(getpid() % 130);
}

inline BusOptions TestOptions(DdsVendor vendor, const std::string& partition = "test") {
  BusOptions options;
  options.vendor = vendor;
  options.domain = TestDomain();
  options.partition = partition;
  return options;
}

inline std::unique_ptr<Bus> MakeTestBus(const BusOptions& options) {
  Result<std::unique_ptr<Bus>> bus = MakeBus(options);
  PORTOLAN_CHECK(bus.ok()) << bus.error().message;
  return std::move(bus).value();
}

inline std::unique_ptr<Bus> MakeTestBus(DdsVendor vendor, const std::string& partition = "test") {
  return MakeTestBus(TestOptions(vendor, partition));
}

/// A place where a handler on a transport thread puts what a test waits for.
template <class T>
class Inbox {
 public:
  void Put(T value) {
    std::lock_guard<std::mutex> lock(mutex_);
    values_.push_back(std::move(value));
    changed_.notify_all();
  }
  /// @return whether `count` values have come before the deadline.
  bool WaitFor(size_t count) {
    std::unique_lock<std::mutex> lock(mutex_);
    return changed_.wait_for(lock, kTestDeadline, [&] { return values_.size() >= count; });
  }
  /// As WaitFor, but not longer than `patience`.
  bool WaitFor(size_t count, std::chrono::milliseconds patience) {
    std::unique_lock<std::mutex> lock(mutex_);
    return changed_.wait_for(lock, patience, [&] { return values_.size() >= count; });
  }
  /// @return whether a value has come for which the condition holds.
  template <class Condition>
  bool WaitUntilAny(Condition condition) {
    std::unique_lock<std::mutex> lock(mutex_);
    return changed_.wait_for(lock, kTestDeadline, [&] {
      for (const T& value : values_) {
        if (condition(value)) return true;
      }
      return false;
    });
  }
  std::vector<T> values() const {
    std::lock_guard<std::mutex> lock(mutex_);
    return values_;
  }

 private:
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<T> values_;
};

/// Publishes a message until its first copy arrives: from then on writer and reader know each other.
/// @return false when none came before the deadline.
template <class T>
bool PublishUntilReceived(Writer<T>* writer, const T& message, Inbox<T>* inbox) {
  const auto deadline = std::chrono::steady_clock::now() + kTestDeadline;
  while (std::chrono::steady_clock::now() < deadline) {
    writer->Write(message);
    if (inbox->WaitFor(1, std::chrono::milliseconds(50))) return true;
  }
  return false;
}

}  // namespace portolan
