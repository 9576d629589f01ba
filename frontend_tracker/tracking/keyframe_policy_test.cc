#include "tracking/keyframe_policy.h"

#include <gtest/gtest.h>

#include "tracking/synthetic_frame.h"

namespace portolan {
namespace {

using Decision = KeyFramePolicy::Decision;

/// A map of two keyframes 0.5 apart at depth about 5, and a frame that tracks it well at `centre_x` along their line.
class KeyFramePolicyTest : public ::testing::Test {
 protected:
  KeyFramePolicyTest() {
    SyntheticSceneOptions options;
    options.num_views = 2;
    options.travel = 0.5;
    scene_ = MakeSyntheticScene(options);
    map_ = BuildMap(scene_);
    static_cast<void>(map_.TakeDelta());
    policy_.StartMap(map_);
  }
  /// The frame tracks the share of the second keyframe's landmarks.
  Frame MakeFrame(double centre_x, double share) const {
    Frame frame = FrameOfView(scene_, 1);
    frame.landmarks = TrueLandmarks(scene_, 1, map_);
    const auto keep = static_cast<size_t>(share * static_cast<double>(frame.landmarks.size()));
    for (size_t i = keep; i < frame.landmarks.size(); ++i) frame.landmarks[i] = MapPointId();
    for (const MapPointId id : frame.landmarks) frame.num_inliers += id.IsValid() ? 1 : 0;
    frame.num_candidates = frame.num_inliers;
    frame.camera_from_map = Rigid3d(Eigen::Quaterniond::Identity(), {-centre_x, 0, 0});
    frame.reference = scene_.views[1].data->id;
    frame.stamp = Timestamp::FromSeconds(100);
    return frame;
  }

  /// Four keyframes instead, whose landmarks count as established.
  void MakeEstablished() {
    SyntheticSceneOptions options = scene_.options;
    options.num_views = 4;
    scene_ = MakeSyntheticScene(options);
    map_ = BuildMap(scene_);
  }

  SyntheticScene scene_;
  Map map_;
  static KeyFramePolicyOptions PaperOptions() {
    KeyFramePolicyOptions options;
    options.distance_factor = 1;
    options.max_reference_overlap = 0.75;
    options.young_keyframes = 0;  // the map here counts as grown
    return options;
  }
  KeyFramePolicy policy_{PaperOptions()};
};

TEST_F(KeyFramePolicyTest, AFarWellTrackedFrameIsInserted) {
  EXPECT_EQ(policy_.Decide(map_, MakeFrame(1.5, 1.0), true), Decision::kInsert);
}

TEST_F(KeyFramePolicyTest, AMapIsLeftWhereItsKeyFramesOrLandmarksEnd) {
  EXPECT_FALSE(policy_.IsLeaving(map_, MakeFrame(0.5, 1.0))) << "at a keyframe";
  EXPECT_TRUE(policy_.IsLeaving(map_, MakeFrame(1.5, 1.0)))
      << "farther from the nearest than the first two from each other";
  Frame frame = MakeFrame(0.5, 1.0);
  frame.num_inliers = 49;
  EXPECT_TRUE(policy_.IsLeaving(map_, frame)) << "hardly anything of it is seen";
  // Only the paper's distance counts, whatever the factor for new keyframes.
  KeyFramePolicyOptions eager = PaperOptions();
  eager.distance_factor = 0.1;
  KeyFramePolicy policy(eager);
  policy.StartMap(map_);
  EXPECT_TRUE(policy.IsFarEnough(map_, MakeFrame(0.6, 1.0)));
  EXPECT_FALSE(policy.IsLeaving(map_, MakeFrame(0.6, 1.0)));
}

TEST_F(KeyFramePolicyTest, BetweenTheFirstTwoAFifthOfTheirDistanceIsEnough) {
  EXPECT_TRUE(policy_.FillsGap(map_, MakeFrame(0.25, 1.0)));
  EXPECT_TRUE(policy_.FillsGap(map_, MakeFrame(0.12, 1.0)));
  EXPECT_FALSE(policy_.FillsGap(map_, MakeFrame(0.08, 1.0)));
  Frame frame = MakeFrame(0.25, 1.0);
  frame.num_inliers = 49;
  EXPECT_FALSE(policy_.FillsGap(map_, frame)) << "quality is poor";
}

TEST_F(KeyFramePolicyTest, QualityNeedsFiftyPointsAndSevenTenths) {
  Frame frame = MakeFrame(1.5, 1.0);
  frame.num_inliers = frame.num_candidates = 49;
  EXPECT_FALSE(policy_.IsQualityGood(map_, frame));
  frame.num_inliers = frame.num_candidates = 50;
  EXPECT_TRUE(policy_.IsQualityGood(map_, frame));
  frame.num_inliers = 70;
  frame.num_candidates = 100;
  EXPECT_FALSE(policy_.IsQualityGood(map_, frame));  // s > 0.7, not equal
  frame.num_inliers = 71;
  EXPECT_TRUE(policy_.IsQualityGood(map_, frame));
  // Many points are good whatever their share: repeated texture must not starve the map.
  frame.num_inliers = 120;
  frame.num_candidates = 400;
  EXPECT_TRUE(policy_.IsQualityGood(map_, frame));
  frame.num_inliers = 119;
  EXPECT_FALSE(policy_.IsQualityGood(map_, frame));
  frame.num_inliers = 0;
  frame.num_candidates = 0;
  EXPECT_FALSE(policy_.IsQualityGood(map_, frame));
  EXPECT_EQ(policy_.Decide(map_, frame, true), Decision::kNo);
}

TEST_F(KeyFramePolicyTest, AYoungMapNeedsThePapersTenPoints) {
  KeyFramePolicyOptions options = PaperOptions();
  options.young_keyframes = 3;  // the map has two
  Frame frame = MakeFrame(1.5, 1.0);
  frame.num_inliers = frame.num_candidates = 9;
  EXPECT_FALSE(KeyFramePolicy(options).IsQualityGood(map_, frame));
  frame.num_inliers = frame.num_candidates = 10;
  EXPECT_TRUE(KeyFramePolicy(options).IsQualityGood(map_, frame));
  options.young_keyframes = 2;
  EXPECT_FALSE(KeyFramePolicy(options).IsQualityGood(map_, frame));
}

/// All landmarks are new, as in a fast turn: they count as soon as few are left.
TEST_F(KeyFramePolicyTest, NewLandmarksCountWhereTheyRunOut) {
  const auto with_inliers = [&](int inliers) {
    Frame frame = MakeFrame(0.5, 1.0);
    EXPECT_GT(frame.num_inliers, 240);
    frame.num_inliers = frame.num_candidates = inliers;
    return frame;
  };
  EXPECT_FALSE(policy_.IsViewNew(map_, with_inliers(130)));
  EXPECT_TRUE(policy_.IsViewNew(map_, with_inliers(110)));
  EXPECT_TRUE(policy_.IsUrgent(map_, with_inliers(110)));
  EXPECT_EQ(policy_.Decide(map_, with_inliers(110), true), Decision::kInsert);
  // Where there never were more than a few, few are no news.
  Map sparse = map_;
  const Frame frame = MakeFrame(0.5, 1.0);
  size_t left = 0;
  for (const MapPointId id : frame.landmarks)
    if (id.IsValid() && ++left > 150) sparse.RemovePoint(id);
  EXPECT_FALSE(policy_.IsViewNew(sparse, with_inliers(110)));
}

TEST_F(KeyFramePolicyTest, DistanceIsMeasuredByDepthFromTheNearestKeyFrame) {
  EXPECT_FALSE(policy_.IsFarEnough(map_, MakeFrame(0.5, 1.0)));   // where the second keyframe is
  EXPECT_FALSE(policy_.IsFarEnough(map_, MakeFrame(0.25, 1.0)));  // between the two
  EXPECT_FALSE(policy_.IsFarEnough(map_, MakeFrame(0.9, 1.0)));
  EXPECT_TRUE(policy_.IsFarEnough(map_, MakeFrame(1.15, 1.0)));
  EXPECT_TRUE(policy_.IsFarEnough(map_, MakeFrame(-0.7, 1.0)));
  // The same way at ten times the depth is not far any more.
  Map deep = map_;
  for (const MapPointId id : deep.SortedPointIds()) deep.SetPosition(id, 10.0f * deep.point(id).position_in_map);
  EXPECT_FALSE(policy_.IsFarEnough(deep, MakeFrame(1.15, 1.0)));
}

TEST_F(KeyFramePolicyTest, ThresholdScalesWithItsFactor) {
  KeyFramePolicyOptions options;
  options.distance_factor = 3;
  KeyFramePolicy strict(options);
  strict.StartMap(map_);
  EXPECT_FALSE(strict.IsFarEnough(map_, MakeFrame(1.15, 1.0)));
  EXPECT_TRUE(strict.IsFarEnough(map_, MakeFrame(2.3, 1.0)));
}

TEST_F(KeyFramePolicyTest, ANewViewCountsWithoutDistance) {
  EXPECT_FALSE(policy_.IsViewNew(map_, MakeFrame(0.5, 0.5)));  // landmarks that only two keyframes see don't count
  MakeEstablished();
  const Frame near_same = MakeFrame(0.5, 1.0), near_new = MakeFrame(0.5, 0.5);
  EXPECT_FALSE(policy_.IsFarEnough(map_, near_new));
  EXPECT_EQ(policy_.Decide(map_, near_same, true), Decision::kNo);
  EXPECT_TRUE(policy_.IsViewNew(map_, near_new));
  EXPECT_EQ(policy_.Decide(map_, near_new, true), Decision::kInsert);
  Frame without_reference = near_new;
  without_reference.reference = KeyFrameId();
  EXPECT_FALSE(policy_.IsViewNew(map_, without_reference));
}

TEST_F(KeyFramePolicyTest, AKnownPlaceIsNotMappedAgainForWhatIsNotTrackedOfIt) {
  MakeEstablished();
  const Frame frame = MakeFrame(0.5, 0.7);
  const KeyFrameId reference = frame.reference;
  const auto later = [&](uint32_t number) {
    return KeyFrameId(reference.robot(), reference.session(), reference.sequence() + number);
  };
  policy_.NoteKeyFrame(later(30), Timestamp::FromSeconds(1));
  EXPECT_FALSE(policy_.IsInKnownPlace(frame));
  EXPECT_EQ(policy_.Decide(map_, frame, true), Decision::kInsert);
  policy_.NoteKeyFrame(later(31), Timestamp::FromSeconds(1));
  EXPECT_TRUE(policy_.IsInKnownPlace(frame));
  EXPECT_EQ(policy_.Decide(map_, frame, true), Decision::kNo);
  EXPECT_EQ(policy_.Decide(map_, MakeFrame(0.5, 0.5), true), Decision::kInsert) << "most is out of sight";
  // What another session or robot mapped is known, whatever its numbers.
  policy_.NoteKeyFrame(KeyFrameId(reference.robot(), reference.session() + 1, 1), Timestamp::FromSeconds(1));
  EXPECT_TRUE(policy_.IsInKnownPlace(frame));
}

TEST_F(KeyFramePolicyTest, AnUrgentFrameNeedsLessQualityIfTheMapperIsIdle) {
  Frame blurred = MakeFrame(1.5, 1.0);  // far enough to be urgent
  blurred.num_inliers = 60;
  blurred.num_candidates = 110;
  EXPECT_FALSE(policy_.IsQualityGood(map_, blurred));
  EXPECT_EQ(policy_.Decide(map_, blurred, true), Decision::kInsert);
  EXPECT_EQ(policy_.Decide(map_, blurred, false), Decision::kNo) << "no reason to stop what the mapper does";
  Frame few = blurred;
  few.num_inliers = few.num_candidates = 49;
  EXPECT_EQ(policy_.Decide(map_, few, true), Decision::kNo)
      << "their pose may be wrong, and the map would go on from it";
  Frame near = MakeFrame(0.0, 1.0);
  near.num_inliers = 60;
  near.num_candidates = 110;
  EXPECT_EQ(policy_.Decide(map_, near, true), Decision::kNo);
}

TEST_F(KeyFramePolicyTest, ABusyMapperIsInterruptedBeforeTheLandmarksRunOut) {
  MakeEstablished();
  // Where it stands at a keyframe, with a view that has changed, but not so much that it would be urgent by its share.
  const Frame turned = MakeFrame(0.5, 0.65);
  const auto decide = [&](const Frame& frame, int few_points) {
    KeyFramePolicyOptions with_few = PaperOptions();
    with_few.few_points = few_points;
    KeyFramePolicy policy(with_few);
    policy.StartMap(map_);
    policy.NoteKeyFrame(frame.reference, Timestamp::FromSeconds(1));
    return policy.Decide(map_, frame, false);
  };
  EXPECT_EQ(decide(turned, turned.num_inliers), Decision::kNo);
  EXPECT_EQ(decide(turned, turned.num_inliers + 1), Decision::kInterrupt);
  const Frame known = MakeFrame(0.5, 0.95);
  EXPECT_EQ(decide(known, known.num_inliers + 1), Decision::kNo) << "few, but no fewer than the keyframe sees";
}

TEST_F(KeyFramePolicyTest, ABusyMapperIsInterruptedOnlyIfItAloneIsInTheWay) {
  EXPECT_EQ(policy_.Decide(map_, MakeFrame(1.5, 1.0), false), Decision::kInterrupt);
  EXPECT_EQ(policy_.Decide(map_, MakeFrame(0.5, 1.0), false), Decision::kNo);
  Frame poor = MakeFrame(1.5, 1.0);
  poor.num_inliers = 40;
  poor.num_candidates = 80;
  EXPECT_EQ(policy_.Decide(map_, poor, false), Decision::kNo);
}

TEST_F(KeyFramePolicyTest, WhatIsNotUrgentWaitsForAnIdleMapper) {
  KeyFramePolicyOptions options = PaperOptions();
  options.distance_factor = 0.5;
  KeyFramePolicy dense(options);
  dense.StartMap(map_);
  const Frame near = MakeFrame(0.9, 1.0), far = MakeFrame(1.15, 1.0);
  EXPECT_EQ(dense.Decide(map_, near, true), Decision::kInsert);
  EXPECT_EQ(dense.Decide(map_, near, false), Decision::kNo);
  EXPECT_EQ(dense.Decide(map_, far, false), Decision::kInterrupt);
}

TEST_F(KeyFramePolicyTest, KeepsTheInterval) {
  KeyFramePolicyOptions options;
  options.min_interval_s = 0.5;
  KeyFramePolicy policy(options);
  policy.StartMap(map_);
  policy.NoteKeyFrame(scene_.views[1].data->id, Timestamp::FromSeconds(99.6));
  EXPECT_EQ(policy.Decide(map_, MakeFrame(1.5, 1.0), true), Decision::kNo);
  policy.NoteKeyFrame(scene_.views[1].data->id, Timestamp::FromSeconds(99.4));
  EXPECT_EQ(policy.Decide(map_, MakeFrame(1.5, 1.0), true), Decision::kInsert);
}

TEST_F(KeyFramePolicyTest, AFrameWithoutLandmarksIsNowhere) {
  Frame frame = MakeFrame(1.5, 0.0);
  EXPECT_FALSE(policy_.IsFarEnough(map_, frame));
  EXPECT_EQ(policy_.Decide(map_, frame, true), Decision::kNo);
}

}  // namespace
}  // namespace portolan
