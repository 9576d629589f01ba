#include "vocabulary/bow_vector.h"

#include <gtest/gtest.h>

#include <cmath>
#include <map>

#include "base/random.h"

namespace portolan {
namespace {

BowVector RandomBow(Random* random) {
  std::map<uint32_t, float> weights;
  for (int i = 0; i < 30; ++i)
    weights[static_cast<uint32_t>(random->Below(60))] = static_cast<float>(random->Uniform(0.1, 1));
  float sum = 0;
  for (const auto& [word, weight] : weights) sum += weight;
  BowVector bow;
  for (const auto& [word, weight] : weights) bow.emplace_back(word, weight / sum);
  return bow;
}

/// 1 - |a - b|_1 / 2 and the number of common words, by the book.
std::pair<double, int> ScoreByDefinition(const BowVector& a, const BowVector& b) {
  const std::map<uint32_t, float> weights_a(a.begin(), a.end()), weights_b(b.begin(), b.end());
  double difference = 0;
  int common = 0;
  for (uint32_t word = 0; word < 60; ++word) {
    const auto in_a = weights_a.find(word), in_b = weights_b.find(word);
    const float weight_a = in_a == weights_a.end() ? 0 : in_a->second,
                weight_b = in_b == weights_b.end() ? 0 : in_b->second;
    difference += std::abs(weight_a - weight_b);
    common += weight_a > 0 && weight_b > 0;
  }
  return {1 - difference / 2, common};
}

TEST(BowScore, IsTheL1ScoreAndSymmetric) {
  Random random(1);
  for (int trial = 0; trial < 100; ++trial) {
    const BowVector a = RandomBow(&random), b = RandomBow(&random);
    const auto [score, common] = ScoreByDefinition(a, b);
    EXPECT_NEAR(BowScore(a, b), score, 1e-5);
    EXPECT_EQ(BowScore(a, b), BowScore(b, a));
    EXPECT_EQ(CountCommonWords(a, b), common);
    EXPECT_EQ(CountCommonWords(b, a), common);
  }
}

TEST(BowScore, IsOneForItselfAndZeroWithoutCommonWords) {
  Random random(2);
  const BowVector bow = RandomBow(&random);
  EXPECT_NEAR(BowScore(bow, bow), 1, 1e-6);
  EXPECT_LE(BowScore(bow, bow), 1);
  EXPECT_EQ(BowScore({{1, 1.0f}}, {{2, 1.0f}}), 0);
  EXPECT_EQ(BowScore({}, bow), 0);
  EXPECT_EQ(BowScore({}, {}), 0);
  EXPECT_EQ(CountCommonWords({}, bow), 0);
}

}  // namespace
}  // namespace portolan
