#include "fuzzing/fuzz_targets.h"

#include <gtest/gtest.h>

#include "base/random.h"

namespace portolan {
namespace {

class FuzzTargetTest : public ::testing::TestWithParam<FuzzTarget> {};

/// Else libFuzzer would begin, and stay, outside of what it is to test.
TEST_P(FuzzTargetTest, SeedsGoAllTheWay) {
  const FuzzTarget& target = GetParam();
  int applied = 0;
  for (const auto& seed : target.make_seeds()) {
    const FuzzOutcome outcome = target.run(seed.data(), seed.size());
    EXPECT_GT(outcome.taken_in, 0);
    applied += outcome.applied;
  }
  const std::string name = target.name;
  const bool has_map = name == "replica" || name == "correction" || name == "stored";
  EXPECT_EQ(applied > 0, has_map);
}

/// A few bytes changed, a piece left out: what libFuzzer does at length (test/reliability/fuzz.sh).
TEST_P(FuzzTargetTest, StandsDamage) {
  const FuzzTarget& target = GetParam();
  Random random(7);
  int taken_in = 0, rounds = 0;
  for (const auto& seed : target.make_seeds()) {
    for (int round = 0; round < 300; ++round, ++rounds) {
      std::vector<uint8_t> damaged = seed;
      for (uint64_t i = random.Below(4); i < 4; ++i)
        damaged[random.Below(damaged.size())] = static_cast<uint8_t>(random.Next());
      if (random.Below(4) == 0) damaged.resize(random.Below(damaged.size()));
      taken_in += target.run(damaged.data(), damaged.size()).taken_in > 0 ? 1 : 0;
    }
  }
  EXPECT_GT(taken_in, 0);
  target.run(nullptr, 0);
}

INSTANTIATE_TEST_SUITE_P(Each, FuzzTargetTest, ::testing::ValuesIn(FuzzTargets()),
                         [](const auto& target) { return std::string(target.param.name); });

TEST(FuzzTargets, AreFoundByName) {
  EXPECT_STREQ(FindFuzzTarget("replica")->name, "replica");
  EXPECT_EQ(FindFuzzTarget("unknown"), nullptr);
}

}  // namespace
}  // namespace portolan
