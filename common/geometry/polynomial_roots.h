#pragma once

#include <array>
#include <cstddef>

namespace portolan {

/// A few real numbers, without heap memory.
class RootList {
 public:
  // Six are usual; rounding to zero at the ends of intervals can add at most as many again.
  static constexpr size_t kCapacity = 24;
  void Add(double root) { roots_[size_++] = root; }
  const double* begin() const { return roots_.data(); }
  const double* end() const { return roots_.data() + size_; }
  size_t size() const { return size_; }

 private:
  std::array<double, kCapacity> roots_{};
  size_t size_ = 0;
};

/// Real roots of c0 + c1 t + ... + c6 t^6, in no particular order, each where the polynomial changes its sign (a root
/// of even multiplicity, where it only touches zero, may be missing). A degree below six is fine; the zero polynomial
/// has no roots here. Between two neighbouring roots of the derivative there is at most one root; it is found by
/// safeguarded Newton steps. Roots outside [-1, 1] are the inverse roots of the reversed polynomial, so that no bound
/// on them is needed.
RootList RealRoots(const std::array<double, 7>& coefficients);

}  // namespace portolan
