#include "map_optimization/global_bundle_adjustment.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <unordered_map>
#include <unordered_set>

#include "map_optimization/map_correction.h"
#include "map_optimization/reprojection_error.h"
#include "testing/map_builder.h"
#include "testing/matchers.h"
#include "testing/synthetic_scene.h"

namespace portolan {
namespace {

using testing::HasSubstr;
using testing::IsEmpty;

class GlobalBundleTest : public testing::Test {
 protected:
  void SetUp() override { Build(0, 0.003, 0.006); }

  /// A closed street: BuildMap knows that a revisit sees the same landmarks.
  void Build(double pixel_sigma, double pose_sigma, double point_sigma) {
    SyntheticSceneOptions options;
    options.landmarks = LandmarkLayout::kStreet;
    options.motion = CameraMotion::kStreetLap;
    options.num_landmarks = 2500;
    options.num_views = 55;
    options.lap = 20;
    options.travel = 22;
    options.sight = 6;
    options.pixel_sigma_px = pixel_sigma;
    scene_ = MakeSyntheticScene(options);
    MapBuilderOptions build;
    build.pose_sigma = pose_sigma;
    build.point_sigma = point_sigma;
    map_ = BuildMap(scene_, build);
    map_.TakeDelta();
  }
  Map Corrected(const MapCorrection& correction) const {
    Map corrected = map_;
    EXPECT_TRUE(ApplyMapCorrection(correction, &corrected).ok());
    EXPECT_THAT(ValidateMap(corrected), IsEmpty());
    return corrected;
  }
  SyntheticScene scene_;
  Map map_;
  KeyFrameAdjustmentOptions options_;
};

TEST_F(GlobalBundleTest, ExactFeaturesLeadToTheTruth) {
  options_.landmarks_per_keyframe = 1000;
  options_.max_iterations = 30;
  options_.function_tolerance = 1e-9;
  std::optional<LossChange> losses;
  const auto correction = AdjustGlobally(map_, options_, nullptr, nullptr, &losses);
  ASSERT_TRUE(correction.ok()) << correction.error().message;
  EXPECT_THAT(Corrected(*correction), MapNear(scene_, MapTolerance{2e-4, 2e-3, 2e-2}));
  ASSERT_TRUE(losses);
  EXPECT_DOUBLE_EQ(losses->with, MeanReprojectionLoss(Corrected(*correction)));
  EXPECT_GT(losses->without, losses->with);
}

TEST_F(GlobalBundleTest, AFewLandmarksOfEachKeyFrameAreEnoughForThePoses) {
  options_.landmarks_per_keyframe = 40;
  const MapError before = CompareWithScene(map_, scene_);
  const auto correction = AdjustGlobally(map_, options_, nullptr, nullptr);
  ASSERT_TRUE(correction.ok()) << correction.error().message;
  const MapError after = CompareWithScene(Corrected(*correction), scene_);
  EXPECT_LT(after.camera_rmse, 0.2 * before.camera_rmse);
}

TEST_F(GlobalBundleTest, NoiseIsReduced) {
  Build(0.33, 0.02, 0.02);
  options_.max_iterations = 30;
  const MapError before = CompareWithScene(map_, scene_);
  const auto correction = AdjustGlobally(map_, options_, nullptr, nullptr);
  ASSERT_TRUE(correction.ok()) << correction.error().message;
  // A view's 100 landmarks of 0.33 px (octave 3: 0.6) at depth 3 and focal length 500 leave 0.0004 of its place; over
  // the 27 views of half a lap errors add up to some 20 times that.
  EXPECT_LT(CompareWithScene(Corrected(*correction), scene_).camera_rmse, std::min(0.3 * before.camera_rmse, 0.01));
}

TEST_F(GlobalBundleTest, KeepsTheMapsFrameAndSize) {
  const auto correction = AdjustGlobally(map_, options_, nullptr, nullptr);
  ASSERT_TRUE(correction.ok());
  const Map corrected = Corrected(*correction);
  const KeyFrameId root = map_.keyframes().begin()->first;
  EXPECT_THAT(corrected.keyframe(root).camera_from_map,
              RigidNear(map_.keyframe(root).camera_from_map, PoseTolerance{1e-9, 1e-9}));
  double before = 0, after = 0;
  for (const auto& [id, keyframe] : map_.keyframes()) {
    before += keyframe.camera_from_map.TargetOriginInSource().squaredNorm();
    after += corrected.keyframe(id).camera_from_map.TargetOriginInSource().squaredNorm();
  }
  EXPECT_NEAR(after / before, 1.0, 1e-6);
}

TEST_F(GlobalBundleTest, ChoosesLongTracksUntilEachKeyFrameHasItsShare) {
  std::vector<KeyFrameId> ids;
  for (const auto& [id, keyframe] : map_.keyframes()) ids.push_back(id);
  const std::vector<MapPointId> selected = SelectLandmarks(map_, ids, 30);
  std::unordered_map<KeyFrameId, int> counts;
  for (const MapPointId id : selected) {
    for (const Observation& o : map_.point(id).observations) ++counts[o.keyframe];
  }
  for (const KeyFrameId id : ids) EXPECT_GE(counts[id], 29) << id;
  for (size_t k = 1; k < selected.size(); ++k) {
    EXPECT_GE(map_.point(selected[k - 1]).observations.size(), map_.point(selected[k]).observations.size());
  }
  EXPECT_LT(selected.size(), map_.points().size() / 2);
}

TEST_F(GlobalBundleTest, AKeyFrameThatNothingHoldsFollows) {
  const KeyFrameId lone = scene_.views[30].data->id;
  for (const MapPointId id : map_.SortedPointIds()) {
    if (map_.point(id).FindObservation(lone) != nullptr) map_.RemoveObservation(id, lone);
  }
  const auto correction = AdjustGlobally(map_, options_, nullptr, nullptr);
  ASSERT_TRUE(correction.ok()) << correction.error().message;
  EXPECT_EQ(correction->keyframes.size(), map_.keyframes().size() - 1);
  for (const auto& keyframe : correction->keyframes) EXPECT_NE(keyframe.id, lone);
}

TEST_F(GlobalBundleTest, WhatMakesTheMapWorseIsRefused) {
  MapCorrection correction = EmptyCorrection(map_, "global_ba");
  std::unordered_set<KeyFrameId> held;
  for (const auto& [id, keyframe] : map_.keyframes()) {
    const double shift = id == map_.keyframes().begin()->first ? 0.0 : 0.03 * static_cast<double>(id.value % 2);
    correction.keyframes.push_back({id, Sim3d(Rigid3d({1, 0, 0, 0}, {shift, 0, 0}) * keyframe.camera_from_map)});
    held.insert(id);
  }
  std::optional<LossChange> losses;
  const Status done = CompleteCorrection(map_, held, options_.followers, nullptr, &correction, &losses);
  ASSERT_FALSE(done.ok());
  EXPECT_THAT(done.error().message, HasSubstr("loss would be"));
  ASSERT_TRUE(losses) << "told also where there is no improvement";
  EXPECT_GT(losses->with, losses->without);
}

TEST_F(GlobalBundleTest, RefusesASmallMap) {
  Map map;
  map.AddKeyFrame(scene_.views[0].data, Rigid3d(), KeyFrameId());
  const auto correction = AdjustGlobally(map, options_, nullptr, nullptr);
  ASSERT_FALSE(correction.ok());
  EXPECT_THAT(correction.error().message, HasSubstr("expected at least 3"));
}

TEST_F(GlobalBundleTest, StopEndsIt) {
  const std::atomic<bool> stop{true};
  const auto correction = AdjustGlobally(map_, options_, &stop, nullptr);
  ASSERT_FALSE(correction.ok());
  EXPECT_THAT(correction.error().message, HasSubstr("interrupted"));
}

TEST_F(GlobalBundleTest, IsDeterministicAndLeavesItsInputAlone) {
  const uint64_t hash = HashMap(map_);
  const auto a = AdjustGlobally(map_, options_, nullptr, nullptr), b = AdjustGlobally(map_, options_, nullptr, nullptr);
  EXPECT_EQ(HashMap(map_), hash);
  ASSERT_TRUE(a.ok() && b.ok());
  EXPECT_EQ(HashMap(Corrected(*a)), HashMap(Corrected(*b)));
}

}  // namespace
}  // namespace portolan
