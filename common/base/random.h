#pragma once

#include <cstdint>

namespace portolan {

/// Random numbers that are the same on every machine for the same seed (SplitMix64; the standard's distributions are
/// not portable). Not for cryptography. Not thread-safe: one per owner.
class Random {
 public:
  explicit Random(uint64_t seed) : state_(seed) {}

  /// Uniform over all 64-bit values.
  uint64_t Next();
  /// Uniform over 0 to n - 1; n at least 1.
  uint64_t Below(uint64_t n);
  /// Uniform in [0, 1).
  double Uniform();
  /// Uniform in [low, high).
  double Uniform(double low, double high) { return low + (high - low) * Uniform(); }
  /// Normal with mean 0 and standard deviation 1 (Box and Muller).
  double Gaussian();

 private:
  uint64_t state_;
  double spare_ = 0;
  bool has_spare_ = false;
};

}  // namespace portolan
