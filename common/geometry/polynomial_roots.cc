#include "geometry/polynomial_roots.h"

#include <cmath>

namespace portolan {
namespace {

constexpr int kDegree = 6;
constexpr int kMaxSteps = 100;        // bisection alone needs about 60 for double precision
constexpr double kTolerance = 1e-15;  // relative to the interval [-1, 1]

using Coefficients = std::array<double, kDegree + 1>;

/// Value and derivative of a polynomial of the given degree by Horner's rule.
void Evaluate(const Coefficients& c, int degree, double t, double* value, double* slope) {
  double v = c[degree], s = 0;
  for (int i = degree - 1; i >= 0; --i) {
    s = s * t + v;
    v = v * t + c[i];
  }
  *value = v;
  *slope = s;
}

/// The root in [low, high], where the polynomial is monotone and its sign differs at the ends: Newton, or bisection
/// where a Newton step would leave the bracket.
double RootInBracket(const Coefficients& c, int degree, double low, double high, double low_value) {
  double t = 0.5 * (low + high);
  for (int step = 0; step < kMaxSteps; ++step) {
    double value, slope;
    Evaluate(c, degree, t, &value, &slope);
    if (value == 0) return t;
    ((value < 0) == (low_value < 0) ? low : high) = t;
    const double newton = t - value / slope;
    const double next = newton > low && newton < high ? newton : 0.5 * (low + high);
    if (std::abs(next - t) <= kTolerance) return next;
    t = next;
  }
  return t;
}

/// Roots in [-1, 1] in ascending order, given those of the derivative: the brackets.
RootList RootsBetween(const Coefficients& c, int degree, const RootList& derivative_roots) {
  RootList roots;
  double low = -1, low_value, slope;
  Evaluate(c, degree, low, &low_value, &slope);
  if (low_value == 0) roots.Add(low);
  const auto visit = [&](double high) {
    double high_value;
    Evaluate(c, degree, high, &high_value, &slope);
    if (high_value == 0) {
      if (high > low) roots.Add(high);
    } else if (low_value != 0 && (low_value < 0) != (high_value < 0)) {
      roots.Add(RootInBracket(c, degree, low, high, low_value));
    }
    low = high;
    low_value = high_value;
  };
  for (const double high : derivative_roots) visit(high);
  visit(1.0);
  return roots;
}

/// Roots in [-1, 1]: from the highest derivative, which is linear, down to the polynomial itself.
RootList RootsInUnitInterval(const Coefficients& c) {
  std::array<Coefficients, kDegree> derivatives;  // [k] is the k-th derivative
  derivatives[0] = c;
  for (int k = 1; k < kDegree; ++k) {
    for (int i = 0; i <= kDegree - k; ++i) derivatives[k][i] = (i + 1) * derivatives[k - 1][i + 1];
  }
  RootList roots;
  for (int k = kDegree - 1; k >= 0; --k) roots = RootsBetween(derivatives[k], kDegree - k, roots);
  return roots;
}

}  // namespace

RootList RealRoots(const std::array<double, 7>& coefficients) {
  bool is_zero = true;
  for (const double c : coefficients) {
    if (!std::isfinite(c)) return {};
    is_zero = is_zero && c == 0;
  }
  if (is_zero) return {};
  Coefficients reversed;
  for (int i = 0; i <= kDegree; ++i) reversed[i] = coefficients[kDegree - i];
  RootList roots = RootsInUnitInterval(coefficients);
  for (const double inverse : RootsInUnitInterval(reversed)) {
    if (std::abs(inverse) < 1 && inverse != 0) roots.Add(1 / inverse);
  }
  return roots;
}

}  // namespace portolan
