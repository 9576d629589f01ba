#include "base/random.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "base/check.h"

namespace portolan {
namespace {

constexpr int kDraws = 100000;

/// Reference values of SplitMix64 from the generator's published C code (Vigna, prng.di.unimi.it) for seed 1234567.
TEST(RandomTest, IsSplitMix64) {
  Random random(1234567);
  EXPECT_EQ(random.Next(), 6457827717110365317ull);
  EXPECT_EQ(random.Next(), 3203168211198807973ull);
  EXPECT_EQ(random.Next(), 9817491932198370423ull);
}

TEST(RandomTest, EqualSeedsGiveEqualNumbersOfEveryKind) {
  Random a(9), b(9);
  for (int i = 0; i < 100; ++i) {
    EXPECT_EQ(a.Below(1000), b.Below(1000));
    EXPECT_EQ(a.Gaussian(), b.Gaussian());
    EXPECT_EQ(a.Uniform(-1, 1), b.Uniform(-1, 1));
  }
}

TEST(RandomTest, OtherSeedsGiveOtherNumbers) {
  EXPECT_NE(Random(1).Next(), Random(2).Next());
}

/// Each of n values comes kDraws / n times; sigma of a count is about its root.
TEST(RandomTest, BelowIsUniform) {
  constexpr uint64_t kValues = 7;
  std::vector<int> counts(kValues);
  Random random(3);
  for (int i = 0; i < kDraws; ++i) ++counts.at(random.Below(kValues));
  const double expected = static_cast<double>(kDraws) / kValues;
  for (const int count : counts) EXPECT_NEAR(count, expected, 5 * std::sqrt(expected));
}

TEST(RandomTest, BelowOneIsZeroAndBelowZeroIsABug) {
  Random random(1);
  EXPECT_EQ(random.Below(1), 0u);
  EXPECT_THROW(random.Below(0), CheckFailure);
}

TEST(RandomTest, UniformStaysInItsIntervalWithTheRightMoments) {
  Random random(5);
  double sum = 0, squares = 0;
  for (int i = 0; i < kDraws; ++i) {
    const double u = random.Uniform(2, 4);
    ASSERT_GE(u, 2);
    ASSERT_LT(u, 4);
    sum += u;
    squares += (u - 3) * (u - 3);
  }
  const double sigma = 2 / std::sqrt(12.0);
  EXPECT_NEAR(sum / kDraws, 3, 5 * sigma / std::sqrt(kDraws));
  EXPECT_NEAR(squares / kDraws, sigma * sigma, 0.01);
}

TEST(RandomTest, GaussianHasTheRightMoments) {
  Random random(6);
  double sum = 0, squares = 0, fourth = 0;
  for (int i = 0; i < kDraws; ++i) {
    const double g = random.Gaussian();
    ASSERT_TRUE(std::isfinite(g));
    sum += g;
    squares += g * g;
    fourth += g * g * g * g;
  }
  const double root = std::sqrt(kDraws);
  EXPECT_NEAR(sum / kDraws, 0, 5 / root);
  EXPECT_NEAR(squares / kDraws, 1, 5 * std::sqrt(2.0) / root);  // the variance of g^2 is 2
  EXPECT_NEAR(fourth / kDraws, 3, 5 * std::sqrt(96.0) / root);  // the variance of g^4 is 96
}

}  // namespace
}  // namespace portolan
