#include "tracking/follower_watch.h"

#include <gtest/gtest.h>

namespace portolan {
namespace {

const ProcessId kLoopCloser(0, 1, 1), kAtlas(0, 2, 1);
const KeyFrameId kFirst(0, 3, 1), kSecond(0, 3, 2);

FollowerState StateOf(ProcessId process, KeyFrameId last, bool is_busy = false) {
  FollowerState state;
  state.process = process;
  state.last_keyframe = last;
  state.is_busy = is_busy;
  return state;
}

TEST(FollowerWatch, WaitsForAllOfThem) {
  FollowerWatch watch;
  EXPECT_TRUE(watch.AreDone(kFirst, 0));
  watch.OnState(StateOf(kLoopCloser, kFirst), 0);
  watch.OnState(StateOf(kAtlas, kFirst), 0);
  EXPECT_TRUE(watch.AreDone(kFirst, 0.1));
  EXPECT_FALSE(watch.AreDone(kSecond, 0.1));
  watch.OnState(StateOf(kLoopCloser, kSecond), 0.2);
  EXPECT_FALSE(watch.AreDone(kSecond, 0.2));
  watch.OnState(StateOf(kAtlas, kSecond), 0.3);
  EXPECT_TRUE(watch.AreDone(kSecond, 0.3));
}

TEST(FollowerWatch, WaitsWhileOneIsBusy) {
  FollowerWatch watch;
  for (double now_s = 0; now_s < 60; ++now_s) {
    watch.OnState(StateOf(kAtlas, kFirst, true), now_s);
    EXPECT_FALSE(watch.AreDone(kFirst, now_s));
  }
}

TEST(FollowerWatch, NotForOneThatIsGone) {
  FollowerWatch watch;
  watch.OnState(StateOf(kAtlas, kFirst, true), 0);
  EXPECT_FALSE(watch.AreDone(kSecond, FollowerWatch::kPatienceS - 0.1));
  EXPECT_TRUE(watch.AreDone(kSecond, FollowerWatch::kPatienceS + 0.1));
}

TEST(FollowerWatch, NotForOneThatGetsNoFurther) {
  FollowerWatch watch;
  for (double now_s = 0; now_s <= FollowerWatch::kStalledS; ++now_s) {
    watch.OnState(StateOf(kAtlas, kFirst), now_s);
    EXPECT_FALSE(watch.AreDone(kSecond, now_s));
  }
  watch.OnState(StateOf(kAtlas, kFirst), FollowerWatch::kStalledS + 1);
  EXPECT_TRUE(watch.AreDone(kSecond, FollowerWatch::kStalledS + 1));
}

/// It serves two robots, and says again and again how far it is with each.
TEST(FollowerWatch, WhatIsRepeatedIsNoProgress) {
  FollowerWatch watch;
  for (double now_s = 0; now_s <= FollowerWatch::kStalledS + 1; ++now_s) {
    watch.OnState(StateOf(kAtlas, kFirst), now_s);
    watch.OnState(StateOf(kAtlas, KeyFrameId(4, 1, 1)), now_s);
    EXPECT_TRUE(watch.AreDone(kFirst, now_s));
    EXPECT_EQ(watch.AreDone(kSecond, now_s), now_s > FollowerWatch::kStalledS) << now_s;
  }
}

TEST(FollowerWatch, NotForOneThatCameInBetween) {
  FollowerWatch watch;
  watch.OnState(StateOf(kLoopCloser, KeyFrameId()), 0);
  EXPECT_TRUE(watch.AreDone(kFirst, 0));
}

TEST(FollowerWatch, RemembersWhatCameBeforeAnotherRobotsKeyFrame) {
  FollowerWatch watch;
  watch.OnState(StateOf(kAtlas, kFirst), 0);
  watch.OnState(StateOf(kAtlas, KeyFrameId(4, 1, 1)), 0.1);
  EXPECT_TRUE(watch.AreDone(kFirst, 0.2));
  EXPECT_FALSE(watch.AreDone(kSecond, 0.2));
}

}  // namespace
}  // namespace portolan
