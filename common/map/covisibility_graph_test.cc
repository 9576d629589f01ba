#include "map/covisibility_graph.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <utility>

#include "base/check.h"
#include "base/random.h"

namespace portolan {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;
using ::testing::Pair;

KeyFrameId Key(uint64_t sequence) {
  return KeyFrameId(0, 1, static_cast<uint32_t>(sequence));
}

TEST(CovisibilityGraph, AgreesWithATableOfPairsThroughChanges) {
  constexpr uint64_t kKeyFrames = 12;
  Random random(1);
  CovisibilityGraph covisibility;
  std::map<std::pair<KeyFrameId, KeyFrameId>, int> common;  // both ways
  for (int step = 0; step < 2000; ++step) {
    const KeyFrameId a = Key(1 + random.Below(kKeyFrames)), b = Key(1 + random.Below(kKeyFrames));
    if (a == b) continue;
    const bool remove = common[{a, b}] > 0 && random.Below(2) == 0;
    for (const auto& pair : {std::pair{a, b}, std::pair{b, a}}) common[pair] += remove ? -1 : 1;
    remove ? covisibility.Remove(a, b) : covisibility.Add(a, b);
    EXPECT_EQ(covisibility.Common(a, b), (common[{a, b}]));
    EXPECT_EQ(covisibility.Common(b, a), (common[{a, b}]));
  }
  for (uint64_t i = 1; i <= kKeyFrames; ++i) {
    CovisibilityGraph::Neighbours expected;
    for (const auto& [pair, count] : common) {
      if (pair.first == Key(i) && count > 0) expected.emplace_back(pair.second, count);
    }
    EXPECT_EQ(covisibility.Of(Key(i)), expected);
  }
}

TEST(CovisibilityGraph, ManyPointsAtOnceAreThoseOfEachPair) {
  constexpr uint32_t kKeyFrames = 20;
  Random random(2);
  std::vector<KeyFrameId> keyframes;
  for (uint32_t i = 0; i < kKeyFrames; ++i) keyframes.push_back(Key(5 + 3 * i));
  std::vector<std::vector<uint32_t>> seen_by(100);
  CovisibilityGraph by_pair;
  for (std::vector<uint32_t>& places : seen_by) {
    const auto first = static_cast<uint32_t>(random.Below(kKeyFrames - 1));  // the last keyframe sees nothing
    for (uint32_t i = first; i < kKeyFrames - 1 && places.size() < random.Below(8); ++i) places.push_back(i);
    for (size_t i = 0; i < places.size(); ++i) {
      for (size_t j = 0; j < i; ++j) by_pair.Add(keyframes[places[i]], keyframes[places[j]]);
    }
  }
  CovisibilityGraph at_once;
  EXPECT_TRUE(at_once.IsEmpty());
  at_once.Fill(keyframes, seen_by);
  EXPECT_FALSE(at_once.IsEmpty());
  for (const KeyFrameId id : keyframes) EXPECT_EQ(at_once.Of(id), by_pair.Of(id)) << id;
  EXPECT_THAT(at_once.Of(keyframes.back()), IsEmpty());
  EXPECT_THROW(at_once.Fill(keyframes, seen_by), CheckFailure);
}

TEST(CovisibilityGraph, NeighboursComeById) {
  CovisibilityGraph covisibility;
  for (const uint64_t i : {3, 1, 4, 1}) covisibility.Add(Key(2), Key(i));
  EXPECT_THAT(covisibility.Of(Key(2)), ElementsAre(Pair(Key(1), 2), Pair(Key(3), 1), Pair(Key(4), 1)));
}

TEST(CovisibilityGraph, UnknownKeyFramesHaveNone) {
  CovisibilityGraph covisibility;
  EXPECT_EQ(covisibility.Common(Key(1), Key(2)), 0);
  EXPECT_THAT(covisibility.Of(Key(1)), IsEmpty());
  covisibility.Forget(Key(1));
  EXPECT_THROW(covisibility.Remove(Key(1), Key(2)), CheckFailure);
}

TEST(CovisibilityGraph, ForgetsOnlyWhatHasNoNeighbours) {
  CovisibilityGraph covisibility;
  covisibility.Add(Key(1), Key(2));
  EXPECT_THROW(covisibility.Forget(Key(1)), CheckFailure);
  covisibility.Remove(Key(1), Key(2));
  covisibility.Forget(Key(1));
  EXPECT_THAT(covisibility.Of(Key(1)), IsEmpty());
}

}  // namespace
}  // namespace portolan
