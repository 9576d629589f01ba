#include "loop/forward_bundle_adjustment.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "map_optimization/global_bundle_adjustment.h"
#include "map_optimization/map_correction.h"
#include "map_optimization/reprojection_error.h"
#include "testing/drifted_map.h"
#include "testing/matchers.h"
#include "testing/synthetic_scene.h"

namespace portolan {
namespace {

using testing::HasSubstr;
using testing::IsEmpty;

/// A street without end, or driven round once and a half, as a map that drifted. A landmark is a word of its own.
class ForwardBundleTest : public testing::Test {
 protected:
  void SetUp() override { Build(100, 0, 0.003, 0.006); }

  void Build(int num_views, double pixel_sigma, double pose_sigma, double point_sigma) {
    SyntheticSceneOptions options;
    options.landmarks = LandmarkLayout::kStreet;
    options.motion = CameraMotion::kStreetLap;
    options.num_landmarks = 12000;
    options.num_views = num_views;
    options.lap = 60;
    options.travel = 0.3 * (num_views - 1);
    options.sight = 8;
    options.pixel_sigma_px = pixel_sigma;
    scene_ = MakeSyntheticScene(options);
    for (SyntheticView& view : scene_.views) {
      KeyFrameData data = *view.data;
      for (const int landmark : view.landmark_of_feature) data.bow.emplace_back(static_cast<uint32_t>(landmark), 0.01f);
      std::sort(data.bow.begin(), data.bow.end());
      view.data = std::make_shared<const KeyFrameData>(std::move(data));
    }
    DriftOptions drift;
    drift.scale_step = 0.9995;
    drift.turn_step = {0, 0.0003, 0};
    drift.pose_sigma = pose_sigma;
    drift.point_sigma = point_sigma;
    map_ = BuildDriftedMap(scene_, drift).map;
    map_.TakeDelta();
  }
  KeyFrameId id(size_t view) const { return scene_.views[view].data->id; }
  KeyFrameId last() const { return scene_.views.back().data->id; }
  Result<MapCorrection> Adjust() { return AdjustForward(map_, last(), {}, options_, nullptr, nullptr); }
  Map Corrected(const MapCorrection& correction) const {
    Map corrected = map_;
    EXPECT_TRUE(ApplyMapCorrection(correction, &corrected).ok());
    EXPECT_THAT(ValidateMap(corrected), IsEmpty());
    return corrected;
  }
  /// How far steps between neighbouring keyframes are from the truth, in rotation and direction, rad: root mean square
  /// and largest.
  std::pair<double, double> StepErrors(const Map& map) const {
    double sum = 0, worst = 0;
    for (size_t k = 1; k < scene_.views.size(); ++k) {
      const Rigid3d step = map.keyframe(id(k)).camera_from_map * map.keyframe(id(k - 1)).camera_from_map.Inverse();
      const Rigid3d truth = scene_.views[k].camera_from_world * scene_.views[k - 1].camera_from_world.Inverse();
      const double turn = step.rotation.angularDistance(truth.rotation);
      const double error = std::max(turn, (step.translation.normalized() - truth.translation.normalized()).norm());
      sum += error * error;
      worst = std::max(worst, error);
    }
    return {std::sqrt(sum / static_cast<double>(scene_.views.size() - 1)), worst};
  }
  SyntheticScene scene_;
  Map map_;
  ForwardBundleOptions options_;
};

TEST_F(ForwardBundleTest, TheTreeIsSparseAndReachesAllThatHangsTogether) {
  std::vector<KeyFrameId> tree = FindForwardPoseTree(map_, last(), options_);
  EXPECT_EQ(tree.front(), last());
  std::sort(tree.begin(), tree.end());
  for (size_t k = 1; k < tree.size(); ++k) {
    const size_t apart = scene_.ViewOf(tree[k]) - scene_.ViewOf(tree[k - 1]);
    EXPECT_GE(apart, 5u);
    EXPECT_LE(apart, 9u);
    const BowVector& bow = map_.keyframe(tree[k]).data->bow;
    EXPECT_GT(CountCommonWords(bow, map_.keyframe(tree[k - 1]).data->bow), options_.min_common_words);
  }
  EXPECT_LT(scene_.ViewOf(tree.front()), 9u);
}

TEST_F(ForwardBundleTest, TheTreeEndsWhereWordsDo) {
  options_.min_common_words = 100000;
  EXPECT_THAT(FindForwardPoseTree(map_, last(), options_), testing::ElementsAre(last()));
}

TEST_F(ForwardBundleTest, LessErrorAndNothingTears) {
  const double loss = MeanReprojectionLoss(map_);
  const auto [step, worst_step] = StepErrors(map_);
  const MapError before = CompareWithScene(map_, scene_);
  const auto correction = Adjust();
  ASSERT_TRUE(correction.ok()) << correction.error().message;
  EXPECT_EQ(correction->kind, "fba");
  EXPECT_EQ(correction->keyframes.size(), map_.keyframes().size());
  const Map corrected = Corrected(*correction);
  EXPECT_LT(MeanReprojectionLoss(corrected), loss);
  EXPECT_LT(StepErrors(corrected).first, 0.7 * step);
  EXPECT_LT(StepErrors(corrected).second, 2 * worst_step);
  EXPECT_LT(CompareWithScene(corrected, scene_).camera_rmse, 0.3 * before.camera_rmse);
}

TEST_F(ForwardBundleTest, NoisyFeaturesDoNotMakeItWorse) {
  Build(100, 0.33, 0.003, 0.006);
  const auto [step, worst_step] = StepErrors(map_);
  const MapError before = CompareWithScene(map_, scene_);
  const auto correction = Adjust();
  ASSERT_TRUE(correction.ok()) << correction.error().message;
  const Map corrected = Corrected(*correction);
  EXPECT_LT(StepErrors(corrected).first, 1.1 * step);
  EXPECT_LT(StepErrors(corrected).second, 2 * worst_step);
  EXPECT_LT(CompareWithScene(corrected, scene_).camera_rmse, 0.5 * before.camera_rmse);
}

TEST_F(ForwardBundleTest, WhatGlobalBundleAdjustmentReachedIsLeftAlone) {
  Build(100, 0.33, 0.003, 0.006);
  // Global BA of all that there is can't be improved by a part of it.
  KeyFrameAdjustmentOptions all;
  all.landmarks_per_keyframe = 100000;
  all.max_iterations = 50;
  const auto global = AdjustGlobally(map_, all, nullptr, nullptr);
  ASSERT_TRUE(global.ok()) << global.error().message;
  map_ = Corrected(*global);
  map_.TakeDelta();
  const auto correction = Adjust();
  ASSERT_FALSE(correction.ok());
  EXPECT_THAT(correction.error().message, HasSubstr("loss would be"));
}

TEST_F(ForwardBundleTest, KeepsTheMapsFrame) {
  const auto correction = Adjust();
  ASSERT_TRUE(correction.ok()) << correction.error().message;
  EXPECT_THAT(Corrected(*correction).keyframe(id(0)).camera_from_map,
              RigidNear(map_.keyframe(id(0)).camera_from_map, PoseTolerance{1e-9, 1e-9}));
}

TEST_F(ForwardBundleTest, AKeyFrameWithoutAWayToTheOthersChangesNothing) {
  options_.min_common_words = 100000;
  const auto correction = Adjust();
  ASSERT_FALSE(correction.ok());
  EXPECT_THAT(correction.error().message, HasSubstr("expected at least 3"));
  EXPECT_FALSE(AdjustForward(map_, KeyFrameId(9, 9, 9), {}, options_, nullptr, nullptr).ok());
}

TEST_F(ForwardBundleTest, StopEndsIt) {
  const std::atomic<bool> stop{true};
  const auto correction = AdjustForward(map_, last(), {}, options_, &stop, nullptr);
  ASSERT_FALSE(correction.ok());
  EXPECT_THAT(correction.error().message, HasSubstr("interrupted"));
}

TEST_F(ForwardBundleTest, IsDeterministic) {
  const auto a = Adjust(), b = Adjust();
  ASSERT_TRUE(a.ok() && b.ok());
  EXPECT_EQ(HashMap(Corrected(*a)), HashMap(Corrected(*b)));
}

}  // namespace
}  // namespace portolan
