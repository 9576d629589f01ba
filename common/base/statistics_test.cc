#include "base/statistics.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace portolan {
namespace {

TEST(StatisticsTest, QuantileInterpolatesBetweenOrderStatistics) {
  const std::vector<double> values{40, 10, 30, 20};
  EXPECT_DOUBLE_EQ(Quantile(values, 0), 10);
  EXPECT_DOUBLE_EQ(Quantile(values, 0.5), 25);
  EXPECT_DOUBLE_EQ(Quantile(values, 1), 40);
  EXPECT_DOUBLE_EQ(Quantile(values, 0.95), 38.5);  // position 2.85 between 30 and 40
}

TEST(StatisticsTest, QuantileOfOneValueIsThatValue) {
  for (const double p : {0.0, 0.3, 1.0}) EXPECT_EQ(Quantile({7}, p), 7);
}

TEST(StatisticsTest, QuantileOfNothingIsZero) {
  EXPECT_EQ(Quantile({}, 0.5), 0);
}

TEST(StatisticsTest, QuantileClampsItsShare) {
  EXPECT_EQ(Quantile({1, 2, 3}, -1), 1);
  EXPECT_EQ(Quantile({1, 2, 3}, 2), 3);
}

TEST(StatisticsTest, StageTimesKeepEverySampleUnderItsStage) {
  StageTimes times;
  times.Add("extract", 5);
  times.Add("match", 1);
  times.Add("extract", 7);
  EXPECT_THAT(times.samples(), testing::ElementsAre(testing::Pair("extract", testing::ElementsAre(5, 7)),
                                                    testing::Pair("match", testing::ElementsAre(1))));
}

}  // namespace
}  // namespace portolan
