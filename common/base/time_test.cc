#include "base/time.h"

#include <gtest/gtest.h>

namespace portolan {
namespace {

TEST(TimeTest, SecondsRoundToTheNearestNanosecond) {
  EXPECT_EQ(Timestamp::FromSeconds(1.5).ns, 1500000000);
  EXPECT_EQ(Timestamp::FromSeconds(0.1).ns, 100000000);
  EXPECT_EQ(Timestamp::FromSeconds(-0.1).ns, -100000000);
  EXPECT_EQ(Timestamp::FromSeconds(0).ns, 0);
}

TEST(TimeTest, SecondsThereAndBack) {
  for (const double seconds : {0.0, 0.033333, 12.75, -3.5, 1403636579.5}) {
    EXPECT_NEAR(Timestamp::FromSeconds(seconds).Seconds(), seconds, 1e-6);
  }
}

TEST(TimeTest, DifferencesKeepNanosecondsOfLargeStamps) {
  const Timestamp a{1403636579763555584};
  const Timestamp b{a.ns + 1};
  EXPECT_DOUBLE_EQ(SecondsBetween(a, b), 1e-9);
  EXPECT_DOUBLE_EQ(SecondsBetween(b, a), -1e-9);
}

TEST(TimeTest, Compares) {
  EXPECT_LT(Timestamp{1}, Timestamp{2});
  EXPECT_LE(Timestamp{2}, Timestamp{2});
  EXPECT_EQ(Timestamp{2}, Timestamp{2});
  EXPECT_NE(Timestamp{2}, Timestamp{3});
}

TEST(TimeTest, NowIsAUnixTime) {
  constexpr int64_t kYear2020 = 1577836800;
  constexpr int64_t kYear2200 = 7258118400;
  EXPECT_GT(Timestamp::Now().Seconds(), kYear2020);
  EXPECT_LT(Timestamp::Now().Seconds(), kYear2200);
}

TEST(TimeTest, StopwatchNeverRunsBackwards) {
  Stopwatch watch;
  const double first = watch.Milliseconds();
  EXPECT_GE(first, 0);
  EXPECT_GE(watch.Milliseconds(), first);
}

}  // namespace
}  // namespace portolan
