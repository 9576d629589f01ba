#include "map_optimization/follower_refinement.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "map_optimization/map_correction.h"
#include "map_optimization/reprojection_error.h"
#include "testing/map_builder.h"
#include "testing/matchers.h"
#include "testing/synthetic_scene.h"

namespace portolan {
namespace {

/// A map with noise, and a correction that puts every other keyframe at its true place and leaves the others.
class FollowerRefinementTest : public testing::Test {
 protected:
  void SetUp() override {
    scene_ = MakeSyntheticScene(SyntheticSceneOptions());
    MapBuilderOptions options;
    options.pose_sigma = 0.003;
    options.point_sigma = 0.005;
    map_ = BuildMap(scene_, options);
    map_.TakeDelta();
    correction_ = EmptyCorrection(map_, "fba");
    for (size_t k = 0; k < scene_.views.size(); ++k) {
      const KeyFrameId id = scene_.views[k].data->id;
      if (k % 2 == 0) held_.insert(id);
      const Rigid3d pose = k % 2 == 0 ? scene_.views[k].camera_from_world : map_.keyframe(id).camera_from_map;
      correction_.keyframes.push_back({id, Sim3d(2.0, pose.rotation, 2.0 * pose.translation)});
    }
  }
  Map Corrected() const {
    Map corrected = map_;
    EXPECT_TRUE(ApplyMapCorrection(correction_, &corrected).ok());
    return corrected;
  }
  SyntheticScene scene_;
  Map map_;
  std::unordered_set<KeyFrameId> held_;
  MapCorrection correction_;
  FollowerOptions options_;
};

TEST_F(FollowerRefinementTest, FollowersFindTheirPlaceBetweenWhatIsHeld) {
  const double before = MeanReprojectionLoss(Corrected());
  options_.rounds = 8;
  ASSERT_TRUE(RefineFollowers(map_, held_, options_, nullptr, &correction_).ok());
  const Map corrected = Corrected();
  EXPECT_LT(MeanReprojectionLoss(corrected), 0.05 * before);
  EXPECT_THAT(corrected, MapNear(scene_, MapTolerance{1e-3, 5e-3, 5e-2}));
  EXPECT_THAT(ValidateMap(corrected), testing::IsEmpty());
}

TEST_F(FollowerRefinementTest, EveryRoundLowersTheError) {
  double last = MeanReprojectionLoss(Corrected());
  options_.rounds = 1;
  for (int round = 0; round < 3; ++round) {
    ASSERT_TRUE(RefineFollowers(map_, held_, options_, nullptr, &correction_).ok());
    const double loss = MeanReprojectionLoss(Corrected());
    EXPECT_LT(loss, last);
    last = loss;
  }
}

TEST_F(FollowerRefinementTest, HeldKeyFramesStayAndScalesToo) {
  const MapCorrection before = correction_;
  ASSERT_TRUE(RefineFollowers(map_, held_, options_, nullptr, &correction_).ok());
  for (size_t k = 0; k < before.keyframes.size(); ++k) {
    const Sim3d& old_pose = before.keyframes[k].camera_from_map;
    const Sim3d& new_pose = correction_.keyframes[k].camera_from_map;
    EXPECT_EQ(new_pose.scale, 2.0);
    EXPECT_EQ((new_pose.translation - old_pose.translation).norm() < 1e-9, held_.count(before.keyframes[k].id) == 1);
  }
}

TEST_F(FollowerRefinementTest, AKeyFrameWithFewLandmarksIsLeft) {
  options_.min_landmarks = 100000;
  const MapCorrection before = correction_;
  ASSERT_TRUE(RefineFollowers(map_, held_, options_, nullptr, &correction_).ok());
  for (size_t k = 0; k < before.keyframes.size(); ++k) {
    EXPECT_LT(
        (correction_.keyframes[k].camera_from_map.translation - before.keyframes[k].camera_from_map.translation).norm(),
        1e-9);
  }
}

TEST_F(FollowerRefinementTest, StopLeavesTheCorrectionAsItWas) {
  const std::atomic<bool> stop{true};
  EXPECT_FALSE(RefineFollowers(map_, held_, options_, &stop, &correction_).ok());
  EXPECT_TRUE(correction_.points.empty());
}

}  // namespace
}  // namespace portolan
