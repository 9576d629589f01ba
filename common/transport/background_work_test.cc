#include "transport/background_work.h"

#include <gtest/gtest.h>

#include <thread>

#include "base/check.h"

namespace portolan {
namespace {

TEST(BackgroundWork, ComesBackAsAnEventOnTheOwnerThread) {
  ProcessLoop loop(16);
  BackgroundWork background(&loop, 1);
  std::thread::id worker, owner;
  background.Start([&](const std::atomic<bool>&) {
    worker = std::this_thread::get_id();
    return [&] {
      owner = std::this_thread::get_id();
      loop.Stop();
    };
  });
  EXPECT_TRUE(background.busy());
  loop.Run();
  EXPECT_FALSE(background.busy());
  EXPECT_EQ(owner, std::this_thread::get_id());
  EXPECT_NE(worker, owner);
}

TEST(BackgroundWork, TakesOneJobAfterAnother) {
  ProcessLoop loop(16);
  BackgroundWork background(&loop, 1);
  int done = 0;
  std::function<void()> start = [&] {
    background.Start([&](const std::atomic<bool>&) {
      return [&] {
        if (++done == 3) return loop.Stop();
        start();
      };
    });
  };
  start();
  EXPECT_THROW(background.Start([](const std::atomic<bool>&) { return nullptr; }), CheckFailure);
  loop.Run();
  EXPECT_EQ(done, 3);
}

TEST(BackgroundWork, ACancelledJobIsToldAndNotHeard) {
  ProcessLoop loop(16);
  BackgroundWork background(&loop, 1);
  bool heard = false, told = false;
  background.Start(
      [&](const std::atomic<bool>& stop) {
        while (!stop) std::this_thread::yield();
        return [&] { heard = true; };
      },
      [&] { told = true; });
  background.Cancel();
  loop.AddTimer(0.001, [&] {
    if (!background.busy()) loop.Stop();
  });
  loop.Run();
  EXPECT_FALSE(heard);
  EXPECT_TRUE(told);
}

TEST(BackgroundWork, AJobsEndIsNotLostToAFullQueue) {
  ProcessLoop loop(1);
  BackgroundWork background(&loop, 1);
  bool heard = false;
  ASSERT_TRUE(loop.Post([] {}));  // the queue is full now
  background.Start([&](const std::atomic<bool>&) {
    return [&] {
      heard = true;
      loop.Stop();
    };
  });
  while (loop.dropped() == 0) std::this_thread::yield();
  loop.AddTimer(30, [&] { loop.Stop(); });  // where it is lost
  loop.Run();
  EXPECT_TRUE(heard);
  EXPECT_FALSE(background.busy()) << "the next one can be started";
}

TEST(BackgroundWork, EndsWithAJobUnderWay) {
  ProcessLoop loop(16);
  std::atomic<bool> started{false};
  {
    BackgroundWork background(&loop, 1);
    background.Start([&](const std::atomic<bool>& stop) {
      started = true;
      while (!stop) std::this_thread::yield();
      return nullptr;
    });
    while (!started) std::this_thread::yield();
  }
  EXPECT_TRUE(started);
}

}  // namespace
}  // namespace portolan
