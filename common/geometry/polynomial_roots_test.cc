#include "geometry/polynomial_roots.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "base/random.h"

namespace portolan {
namespace {

/// Coefficients, from t^0, of leading * product of (t - root).
std::array<double, 7> FromRoots(const std::vector<double>& roots, double leading) {
  std::array<double, 7> c{leading};
  int degree = 0;
  for (const double root : roots) {
    for (int i = ++degree; i > 0; --i) c[i] = c[i - 1] - root * c[i];
    c[0] *= -root;
  }
  return c;
}

std::vector<double> SortedRoots(const std::array<double, 7>& c) {
  const RootList list = RealRoots(c);
  std::vector<double> roots(list.begin(), list.end());
  std::sort(roots.begin(), roots.end());
  return roots;
}

TEST(PolynomialRootsTest, FindsSixSimpleRootsOnBothSidesOfOne) {
  EXPECT_THAT(SortedRoots(FromRoots({-300, -0.5, -0.01, 0.25, 2, 40}, 3)),
              testing::Pointwise(testing::DoubleNear(1e-6), {-300.0, -0.5, -0.01, 0.25, 2.0, 40.0}));
}

TEST(PolynomialRootsTest, FindsRootsAtTheEndsOfTheInterval) {
  EXPECT_THAT(SortedRoots(FromRoots({-1, 0, 1}, 1)), testing::ElementsAre(-1, 0, 1));
}

TEST(PolynomialRootsTest, DegreeMayBeLess) {
  EXPECT_THAT(SortedRoots({-6, 2, 0, 0, 0, 0, 0}), testing::ElementsAre(testing::DoubleEq(3)));
  EXPECT_THAT(SortedRoots({1, 0, 0, 0, 0, 0, 0}), testing::IsEmpty());
}

TEST(PolynomialRootsTest, ComplexRootsAreNotReported) {
  EXPECT_THAT(SortedRoots({1, 0, 1, 0, 0, 0, 0}), testing::IsEmpty());  // t^2 + 1
}

TEST(PolynomialRootsTest, ZeroAndNonFinitePolynomialsHaveNone) {
  EXPECT_EQ(RealRoots({}).size(), 0u);
  EXPECT_EQ(RealRoots({1, std::nan(""), 0, 0, 0, 0, 1}).size(), 0u);
}

TEST(PolynomialRootsTest, RandomRootsComeBack) {
  Random random(1);
  for (int trial = 0; trial < 200; ++trial) {
    std::vector<double> roots;
    for (int i = 0; i < 6; ++i) roots.push_back((i - 2.7) * random.Uniform(0.8, 1.0));  // apart from each other
    EXPECT_THAT(SortedRoots(FromRoots(roots, random.Uniform(0.1, 10))),
                testing::Pointwise(testing::DoubleNear(1e-8), roots));
  }
}

}  // namespace
}  // namespace portolan
