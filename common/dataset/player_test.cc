#include "dataset/player.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <condition_variable>
#include <mutex>
#include <thread>
#include <vector>

#include "base/check.h"

namespace portolan {
namespace {

using std::chrono::steady_clock;
using testing::ElementsAre;

/// What the source and the test tell each other across threads.
class Progress {
 public:
  void AddStep() {
    {
      std::lock_guard<std::mutex> lock(mutex_);
      ++steps_;
    }
    changed_.notify_all();
  }
  void WaitForSteps(int steps) {
    std::unique_lock<std::mutex> lock(mutex_);
    changed_.wait(lock, [&] { return steps_ >= steps; });
  }
  int steps() {
    std::lock_guard<std::mutex> lock(mutex_);
    return steps_;
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  int steps_ = 0;
};

struct FakeOptions {
  int num_frames = 10;
  double interval = 1e-3;       ///< seconds
  std::vector<int> unreadable;  ///< frames whose Next() fails
  bool live = false;
  bool peeks = false;         ///< PeekStamp() knows the stamp
  Progress* calls = nullptr;  ///< told at the start of every Next()
  Progress* go_on = nullptr;  ///< the second frame waits for its first step
};

/// Frames of one pixel at even intervals.
class FakeSource : public ImageSource {
 public:
  explicit FakeSource(const FakeOptions& options) : options_(options) {}
  Result<std::optional<Image>> Next() override {
    if (options_.calls) options_.calls->AddStep();
    if (options_.go_on && next_ == 1) options_.go_on->WaitForSteps(1);
    if (next_ == options_.num_frames) return std::optional<Image>();
    const int frame = next_++;
    for (const int unreadable : options_.unreadable) {
      if (frame == unreadable) return Error{"frame " + std::to_string(frame) + " is broken"};
    }
    return std::optional<Image>(
        Image{static_cast<uint64_t>(frame), StampOf(frame), cv::Mat(1, 1, CV_8UC1, cv::Scalar(frame))});
  }
  std::optional<Timestamp> PeekStamp() const override {
    return options_.peeks && next_ < options_.num_frames ? std::optional<Timestamp>(StampOf(next_)) : std::nullopt;
  }
  void Skip() override { ++next_; }
  void Cancel() override {
    if (options_.go_on) options_.go_on->AddStep();
  }
  const CameraModel& camera() const override { return camera_; }
  bool IsLive() const override { return options_.live; }

 private:
  Timestamp StampOf(int frame) const { return Timestamp::FromSeconds(100 + frame * options_.interval); }

  const FakeOptions options_;
  const CameraModel camera_;
  int next_ = 0;
};

std::unique_ptr<ImageSource> MakeSource(const FakeOptions& options) {
  return std::make_unique<FakeSource>(options);
}

std::vector<uint64_t> PlayToEnd(Player* player) {
  std::vector<uint64_t> frames;
  while (const auto frame = player->WaitForNext()) frames.push_back(frame->image.frame);
  return frames;
}

std::vector<uint64_t> Counting(uint64_t count) {
  std::vector<uint64_t> numbers;
  for (uint64_t i = 0; i < count; ++i) numbers.push_back(i);
  return numbers;
}

class PlayerWithoutPaceTest : public testing::TestWithParam<PlaybackMode> {};

TEST_P(PlayerWithoutPaceTest, DeliversEveryFrameInOrder) {
  FakeOptions fake;
  fake.num_frames = 200;
  Player player(MakeSource(fake), {GetParam(), 1, 3});
  EXPECT_EQ(PlayToEnd(&player), Counting(200));
  EXPECT_EQ(player.report().delivered, 200u);
  EXPECT_EQ(player.report().dropped, 0u);
  EXPECT_EQ(player.WaitForNext(), std::nullopt) << "the end stays the end";
}

TEST_P(PlayerWithoutPaceTest, CountsAndReportsUnreadableFrames) {
  FakeOptions fake;
  fake.unreadable = {0, 4, 9};
  Player player(MakeSource(fake), {GetParam(), 1, 3});
  EXPECT_THAT(PlayToEnd(&player), ElementsAre(1, 2, 3, 5, 6, 7, 8));
  EXPECT_EQ(player.report().unreadable, 3u);
  EXPECT_THAT(player.report().messages, ElementsAre("frame 0 is broken", "frame 4 is broken", "frame 9 is broken"));
}

TEST_P(PlayerWithoutPaceTest, ReadsAheadOnlyAsFarAsItsQueue) {
  Progress calls;
  FakeOptions fake;
  fake.num_frames = 100;
  fake.calls = &calls;
  Player player(MakeSource(fake), {GetParam(), 1, 3});
  calls.WaitForSteps(4);  // three wait in the queue, the fourth for its place there
  for (uint64_t i = 0; i < 10; ++i) {
    EXPECT_EQ(player.WaitForNext()->image.frame, i);
    EXPECT_LE(calls.steps(), static_cast<int>(i) + 1 + 4);
  }
}

TEST_P(PlayerWithoutPaceTest, GoesOnBehindTheFramesThatWerePlayed) {
  PlaybackOptions options{GetParam(), 1, 3};
  options.go_on = PlaybackOptions::GoOn{std::nullopt, 7};
  Player player(MakeSource({}), options);
  EXPECT_THAT(PlayToEnd(&player), ElementsAre(7, 8, 9));
  EXPECT_EQ(player.report().passed, 7u);
}

INSTANTIATE_TEST_SUITE_P(Modes, PlayerWithoutPaceTest, testing::Values(PlaybackMode::kMax, PlaybackMode::kLockstep));

TEST(PlayerTest, InRealTimeNoFrameComesBeforeItsTime) {
  FakeOptions fake;
  fake.num_frames = 30;
  fake.interval = 4e-3;
  Player player(MakeSource(fake), {PlaybackMode::kRealTime, 2, 30});  // a queue that holds all: nothing can be dropped
  const auto start = steady_clock::now();
  uint64_t delivered = 0;
  while (const auto frame = player.WaitForNext()) {
    const auto due = start + std::chrono::microseconds(2000 * frame->image.frame);
    EXPECT_GE(frame->available, due);
    EXPECT_GE(steady_clock::now(), frame->available);
    EXPECT_EQ(frame->image.frame, delivered++);
  }
  EXPECT_EQ(delivered, 30u);
}

TEST(PlayerTest, ThePlaybackStartsWithTheFirstWait) {
  Progress calls;
  FakeOptions fake;
  fake.calls = &calls;
  Player player(MakeSource(fake), {PlaybackMode::kRealTime, 1, 10});
  calls.WaitForSteps(1);
  const auto before = steady_clock::now();
  const auto frame = player.WaitForNext();
  EXPECT_EQ(frame->image.frame, 0u);
  EXPECT_GE(frame->available, before);
}

/// The consumer takes one frame and comes back when all others have come.
TEST(PlayerTest, InRealTimeTheOldestFramesGoWhenNobodyTakesThem) {
  Progress calls, taken;
  FakeOptions fake;
  fake.num_frames = 20;
  fake.interval = 1e-4;
  fake.calls = &calls;
  fake.go_on = &taken;
  Player player(MakeSource(fake), {PlaybackMode::kRealTime, 1, 3});
  EXPECT_EQ(player.WaitForNext()->image.frame, 0u);
  taken.AddStep();
  calls.WaitForSteps(21);  // the call that finds the end
  EXPECT_THAT(PlayToEnd(&player), ElementsAre(17, 18, 19));
  EXPECT_EQ(player.report().delivered, 4u);
  EXPECT_EQ(player.report().dropped, 16u);
}

/// At a billion times the speed all others are late as soon as the first one was shown: they are passed over without a
/// Next().
TEST(PlayerTest, LateFramesArePassedOverUndecoded) {
  Progress calls;
  FakeOptions fake;
  fake.num_frames = 50;
  fake.peeks = true;
  fake.calls = &calls;
  Player player(MakeSource(fake), {PlaybackMode::kRealTime, 1e9, 3});
  EXPECT_THAT(PlayToEnd(&player), ElementsAre(0));
  EXPECT_EQ(calls.steps(), 2) << "the first frame and the end";
  EXPECT_EQ(player.report().dropped, 49u);
}

TEST(PlayerTest, EveryFrameIsDeliveredDroppedOrUnreadable) {
  FakeOptions fake;
  fake.num_frames = 500;
  fake.interval = 1e-5;
  fake.peeks = true;
  fake.unreadable = {7, 8, 499};
  Player player(MakeSource(fake), {PlaybackMode::kRealTime, 1, 2});
  const std::vector<uint64_t> frames = PlayToEnd(&player);
  for (size_t i = 1; i < frames.size(); ++i) EXPECT_LT(frames[i - 1], frames[i]);
  const PlaybackReport report = player.report();
  EXPECT_EQ(report.delivered, frames.size());
  EXPECT_EQ(report.delivered + report.dropped + report.unreadable, 500u);
}

/// At its recorded pace this source would take a day.
TEST(PlayerTest, GoesOnWhereTheClockIs) {
  for (const bool peeks : {true, false}) {
    FakeOptions fake;
    fake.num_frames = 400;
    fake.peeks = peeks;
    PlaybackOptions options;
    options.go_on = PlaybackOptions::GoOn{
        PlaybackStart{Timestamp::FromSeconds(100), steady_clock::now() - std::chrono::milliseconds(100)}, 0};
    Player player(MakeSource(fake), options);
    const std::vector<uint64_t> frames = PlayToEnd(&player);
    const PlaybackReport report = player.report();
    EXPECT_GE(report.passed, 100u) << "a frame each millisecond";
    ASSERT_FALSE(frames.empty());
    EXPECT_GE(frames.front(), report.passed);
    EXPECT_EQ(frames.back(), 399u);
    EXPECT_EQ(report.passed + report.delivered + report.dropped, 400u);
  }
}

TEST(PlayerTest, WhatIsOverGoesOnNowhere) {
  PlaybackOptions options;
  options.go_on = PlaybackOptions::GoOn{
      PlaybackStart{Timestamp::FromSeconds(100), steady_clock::now() - std::chrono::seconds(1)}, 0};
  Player player(MakeSource({}), options);
  EXPECT_THAT(PlayToEnd(&player), ElementsAre());
  EXPECT_EQ(player.report().passed, 10u);
}

TEST(PlayerTest, ALiveSourceIsNotPaced) {
  FakeOptions fake;
  fake.num_frames = 3;
  fake.interval = 40000;
  fake.live = true;
  Player player(MakeSource(fake), {PlaybackMode::kRealTime, 1, 3});
  EXPECT_EQ(PlayToEnd(&player), Counting(3));
}

TEST(PlayerTest, StopWakesTheConsumerAndEndsTheWaitForADistantFrame) {
  FakeOptions fake;
  fake.interval = 40000;
  Player player(MakeSource(fake), {PlaybackMode::kRealTime, 1, 3});
  ASSERT_TRUE(player.WaitForNext());
  std::optional<PlayedFrame> frame;
  std::thread consumer([&] { frame = player.WaitForNext(); });
  player.Stop();
  consumer.join();
  EXPECT_FALSE(frame);
}

TEST(PlayerTest, StopEndsTheSourcesWaitForAnImage) {
  Progress calls, go_on;
  FakeOptions fake;
  fake.live = true;
  fake.calls = &calls;
  fake.go_on = &go_on;
  {
    const Player player(MakeSource(fake), {PlaybackMode::kRealTime, 1, 3});
    calls.WaitForSteps(2);
  }
  EXPECT_GE(go_on.steps(), 1) << "cancelled, or this would never have come to its end";
}

TEST(PlayerTest, CanBeDestroyedBeforeAnyoneWaited) {
  for (const PlaybackMode mode : {PlaybackMode::kRealTime, PlaybackMode::kMax}) {
    Progress calls;
    FakeOptions fake;
    fake.calls = &calls;
    const Player player(MakeSource(fake), {mode, 1, 1});
    calls.WaitForSteps(1);
  }
}

TEST(PlayerTest, KeepsOnlyTheFirstMessages) {
  FakeOptions fake;
  fake.num_frames = 40;
  for (int i = 0; i < 40; ++i) fake.unreadable.push_back(i);
  Player player(MakeSource(fake), {PlaybackMode::kMax, 1, 3});
  EXPECT_FALSE(player.WaitForNext());
  EXPECT_EQ(player.report().unreadable, 40u);
  EXPECT_EQ(player.report().messages.size(), PlaybackReport::kMaxMessages);
}

TEST(PlayerTest, ParsesSpeeds) {
  EXPECT_EQ(ParseSpeed("max")->mode, PlaybackMode::kMax);
  EXPECT_EQ(ParseSpeed("lockstep")->mode, PlaybackMode::kLockstep);
  EXPECT_EQ(ParseSpeed("0.5")->mode, PlaybackMode::kRealTime);
  EXPECT_EQ(ParseSpeed("0.5")->factor, 0.5);
  for (const char* bad : {"", "0", "-1", "nan", "inf", "fast", "1x"}) EXPECT_FALSE(ParseSpeed(bad)) << bad;
}

TEST(PlaybackClockTest, FramesAreDueAtTheirTimesDividedByTheFactor) {
  const steady_clock::time_point start(std::chrono::seconds(1000));
  for (const double factor : {0.5, 1.0, 4.0}) {
    PlaybackClock clock(factor);
    EXPECT_FALSE(clock.started());
    clock.Start(Timestamp{5000000000}, start);
    EXPECT_EQ(clock.DueAt(Timestamp{5000000000}), start);
    EXPECT_EQ(clock.DueAt(Timestamp{7000000000}), start + std::chrono::nanoseconds(static_cast<int64_t>(2e9 / factor)));
  }
}

TEST(PlaybackClockTest, WrongUseIsABug) {
  EXPECT_THROW(PlaybackClock(0), CheckFailure);
  EXPECT_THROW(PlaybackClock(-1), CheckFailure);
  EXPECT_THROW(static_cast<void>(PlaybackClock(1).DueAt(Timestamp{})), CheckFailure);
}

}  // namespace
}  // namespace portolan
