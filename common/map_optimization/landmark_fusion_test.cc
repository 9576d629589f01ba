#include "map_optimization/landmark_fusion.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <set>

#include "testing/drifted_map.h"
#include "testing/synthetic_scene.h"

namespace portolan {
namespace {

using testing::IsEmpty;

/// A street seen one and a tenth times: the last views know their own copies of what the first ones see.
class LandmarkFusionTest : public testing::Test {
 protected:
  void SetUp() override {
    SyntheticSceneOptions options;
    options.landmarks = LandmarkLayout::kStreet;
    options.motion = CameraMotion::kStreetLap;
    options.num_landmarks = 1000;
    options.num_views = 45;
    options.lap = 20;
    options.travel = 22;
    options.sight = 6;
    options.num_clutter = 20;
    options.descriptor_flip_ratio = 0.03;
    scene_ = MakeSyntheticScene(options);
    const DriftedMap drifted = BuildDriftedMap(scene_, DriftOptions());
    map_ = drifted.map;
    num_seen_again_ = drifted.TrueSightings(scene_, 44, 4).size();
    for (size_t k = 0; k < 8; ++k) first_.push_back(scene_.views[k].data->id);
    last_ = scene_.views[44].data->id;
  }
  /// The scene's landmark that an observation shows.
  int LandmarkOf(const Observation& o) const {
    return scene_.views[scene_.ViewOf(o.keyframe)].landmark_of_feature[o.feature];
  }
  SyntheticScene scene_;
  Map map_;
  std::vector<KeyFrameId> first_;
  KeyFrameId last_;
  size_t num_seen_again_ = 0;
};

TEST_F(LandmarkFusionTest, FindsWhatARevisitSees) {
  const std::vector<MapPointId> points = LandmarksOf(map_, first_);
  LandmarkFusionOptions options;
  options.keep_projected = true;
  FusionResult result;
  FuseIntoKeyFrame(&map_, last_, points, options, &result);
  EXPECT_GT(result.merges.size() + result.observations.size(), num_seen_again_ * 9 / 10);
  for (const auto& [from, into] : result.merges) {
    EXPECT_EQ(map_.FindPoint(from), nullptr);
    const MapPoint& point = map_.point(into);
    EXPECT_EQ(std::count(points.begin(), points.end(), into), 1) << "the projected one stays";
    for (const Observation& o : point.observations) EXPECT_EQ(LandmarkOf(o), LandmarkOf(point.observations[0]));
  }
  for (const auto& [id, observation] : result.observations) {
    EXPECT_EQ(observation.keyframe, last_);
    EXPECT_EQ(LandmarkOf(observation), LandmarkOf(map_.point(id).observations[0]));
  }
  EXPECT_THAT(ValidateMap(map_), IsEmpty());
}

TEST_F(LandmarkFusionTest, TheOneWithMoreObservationsStaysUnlessAskedOtherwise) {
  std::map<MapPointId, size_t> sizes;
  for (const auto& [id, point] : map_.points()) sizes[id] = point.observations.size();
  FusionResult result;
  FuseIntoKeyFrame(&map_, last_, LandmarksOf(map_, first_), LandmarkFusionOptions(), &result);
  ASSERT_GT(result.merges.size(), num_seen_again_ / 2);
  for (const auto& [from, into] : result.merges) EXPECT_GE(sizes[into], sizes[from]);
}

TEST_F(LandmarkFusionTest, PassesOverWhatIsGoneOrSeen) {
  FusionResult result;
  std::vector<MapPointId> points = LandmarksOf(map_, {last_});
  points.push_back(MapPointId(7, 7, 7));
  FuseIntoKeyFrame(&map_, last_, points, LandmarkFusionOptions(), &result);
  EXPECT_TRUE(result.observations.empty());
  EXPECT_TRUE(result.merges.empty());
}

TEST_F(LandmarkFusionTest, FindsNothingInAKeyFrameWithoutDescriptors) {
  map_.ReplaceData(last_, WithoutAppearance(*map_.keyframe(last_).data));
  FusionResult result;
  FuseIntoKeyFrame(&map_, last_, LandmarksOf(map_, first_), LandmarkFusionOptions(), &result);
  EXPECT_TRUE(result.observations.empty());
  EXPECT_TRUE(result.merges.empty());
}

TEST_F(LandmarkFusionTest, LandmarksOfKeyFramesComeOnce) {
  const std::vector<MapPointId> points = LandmarksOf(map_, {first_[0], first_[1]});
  EXPECT_EQ(std::set<MapPointId>(points.begin(), points.end()).size(), points.size());
  for (const MapPointId id : points) {
    EXPECT_TRUE(map_.point(id).FindObservation(first_[0]) != nullptr ||
                map_.point(id).FindObservation(first_[1]) != nullptr);
  }
}

}  // namespace
}  // namespace portolan
