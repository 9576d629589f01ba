#include "transport/process_loop.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <future>
#include <thread>

namespace portolan {
namespace {

TEST(ProcessLoopTest, RunsEventsInTheirOrderOnItsThread) {
  ProcessLoop loop(100);
  std::vector<int> order;
  std::thread::id thread;
  for (int i = 0; i < 50; ++i) ASSERT_TRUE(loop.Post([&order, i] { order.push_back(i); }));
  loop.Post([&] { thread = std::this_thread::get_id(); });
  loop.Post([&] { loop.Stop(); });
  EXPECT_EQ(loop.Run(), 0);
  ASSERT_EQ(order.size(), 50u);
  for (int i = 0; i < 50; ++i) EXPECT_EQ(order[static_cast<size_t>(i)], i);
  EXPECT_EQ(thread, std::this_thread::get_id());
}

TEST(ProcessLoopTest, EventsFromOtherThreadsWakeIt) {
  ProcessLoop loop(10);
  std::promise<void> running;
  loop.Post([&] { running.set_value(); });
  std::thread other([&] {
    running.get_future().wait();
    loop.Post([&] { loop.Stop(); });
  });
  EXPECT_EQ(loop.Run(), 0);
  other.join();
}

TEST(ProcessLoopTest, WhatWasPostedBeforeTheEndIsStillDone) {
  ProcessLoop loop(10);
  bool done = false;
  loop.Stop();
  loop.Post([&] { done = true; });
  loop.Run();
  EXPECT_TRUE(done);
  EXPECT_FALSE(loop.Post([] {}));  // it has ended
}

TEST(ProcessLoopTest, AFullQueueRefusesAndCounts) {
  ProcessLoop loop(2);
  EXPECT_TRUE(loop.Post([] {}));
  EXPECT_TRUE(loop.Post([] {}));
  EXPECT_FALSE(loop.Post([] {}));
  EXPECT_EQ(loop.depth(), 2u);
  EXPECT_EQ(loop.dropped(), 1u);
}

TEST(ProcessLoopTest, WhatWaitsHoldsNoMoreThanItMay) {
  ProcessLoop loop(100, 1000);
  int done = 0;
  EXPECT_TRUE(loop.Post([&] { ++done; }, 600));
  EXPECT_FALSE(loop.Post([&] { ++done; }, 600));
  EXPECT_TRUE(loop.Post([&] { ++done; }, 400));
  EXPECT_FALSE(loop.Post([&] { ++done; }, 1));
  EXPECT_TRUE(loop.Post([&] { ++done; })) << "small events have room";
  EXPECT_EQ(loop.dropped(), 2u);
  // What was done holds nothing any more.
  loop.Post([&] {
    EXPECT_TRUE(loop.Post([&] { ++done; }, 1000));
    loop.Stop();
  });
  loop.Run();
  EXPECT_EQ(done, 4);
}

TEST(ProcessLoopTest, TimersComeAgainAndAgain) {
  ProcessLoop loop(10);
  int fast = 0, slow = 0;
  loop.AddTimer(0.001, [&] { ++fast; });
  loop.AddTimer(0.010, [&] {
    if (++slow == 3) loop.Stop();
  });
  loop.Run();
  EXPECT_EQ(slow, 3);
  EXPECT_GE(fast, 3);
}

TEST(ProcessLoopTest, TimersGetTheirTurnBetweenEventsThatPostEvents) {
  ProcessLoop loop(10);
  std::function<void()> again = [&] { loop.Post(again); };
  loop.Post(again);
  bool stopping = false;
  loop.AddTimer(0.001, [&] {
    stopping = true;
    again = [] {};
    loop.Stop();
  });
  loop.Run();
  EXPECT_TRUE(stopping);
}

TEST(ProcessLoopTest, SignalsEndIt) {
  for (const int signal : {SIGINT, SIGTERM}) {
    ProcessLoop loop(10);
    loop.Post([signal] { kill(getpid(), signal); });
    EXPECT_EQ(loop.Run(), signal);
  }
}

TEST(ProcessLoopTest, SignalsAreAsBeforeAfterwards) {
  sigset_t before, after;
  pthread_sigmask(SIG_BLOCK, nullptr, &before);
  {
    ProcessLoop loop(10);
    loop.Stop();
    loop.Run();
    pthread_sigmask(SIG_BLOCK, nullptr, &after);
    EXPECT_EQ(sigismember(&before, SIGINT), sigismember(&after, SIGINT));
  }
  { ProcessLoop never_run(10); }
  pthread_sigmask(SIG_BLOCK, nullptr, &after);
  EXPECT_EQ(sigismember(&before, SIGTERM), sigismember(&after, SIGTERM));
}

}  // namespace
}  // namespace portolan
