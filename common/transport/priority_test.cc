#include "transport/priority.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sched.h>
#include <sys/resource.h>

#include <thread>

namespace portolan {
namespace {

using testing::HasSubstr;
using testing::StartsWith;

/// Priorities belong to threads: each test changes those of its own.
template <class Work>
void InThread(Work work) {
  std::thread(work).join();
}

TEST(PriorityTest, RangesAreChecked) {
  EXPECT_TRUE(PriorityOptions().Check().ok());
  EXPECT_THAT((PriorityOptions{20, 0}).Check().error().message, HasSubstr("priority.nice is 20"));
  EXPECT_THAT((PriorityOptions{-21, 0}).Check().error().message, HasSubstr("-21"));
  EXPECT_THAT((PriorityOptions{0, 100}).Check().error().message, HasSubstr("priority.realtime is 100"));
  EXPECT_THAT((PriorityOptions{0, -1}).Check().error().message, HasSubstr("-1"));
}

TEST(PriorityTest, StandingBackIsAlwaysPermitted) {
  InThread([] {
    EXPECT_EQ(SetPriority({15, 0}), "nice 15");
    EXPECT_EQ(getpriority(PRIO_PROCESS, 0), 15);
    LowerThreadPriority(2);
    EXPECT_EQ(DescribePriority(), "nice 17");
    LowerThreadPriority(100);
    EXPECT_EQ(DescribePriority(), "nice 19");
  });
}

TEST(PriorityTest, ThreadsStartedLaterInherit) {
  InThread([] {
    SetPriority({16, 0});
    InThread([] { EXPECT_EQ(DescribePriority(), "nice 16"); });
  });
}

TEST(PriorityTest, RealTimeIsInForceOrTheReasonIsGiven) {
  InThread([] {
    const std::string described = SetPriority({17, 5});
    if (sched_getscheduler(0) == SCHED_RR) {
      EXPECT_EQ(described, "SCHED_RR 5");
      LowerThreadPriority(1);
      EXPECT_EQ(DescribePriority(), "nice 18");
    } else {
      EXPECT_THAT(described, StartsWith("nice 17 (SCHED_RR 5: "));
    }
  });
}

}  // namespace
}  // namespace portolan
