#include "map_optimization/map_correction.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>

#include "testing/map_builder.h"
#include "testing/synthetic_scene.h"

namespace portolan {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;

class MapCorrectionTest : public ::testing::Test {
 protected:
  void SetUp() override {
    SyntheticSceneOptions options;
    options.num_views = 6;
    options.num_clutter = 20;
    scene_ = MakeSyntheticScene(options);
    map_ = BuildMap(scene_);
    map_.TakeDelta();
    correction_ = EmptyCorrection(map_, "loop");
    correction_.number = 3;
  }
  KeyFrameId id(size_t view) const { return scene_.views[view].data->id; }
  /// Asks for the keyframe to be where the similarity takes it.
  void AddCorrected(size_t view, const Sim3d& new_from_old) {
    const Sim3d old(map_.keyframe(id(view)).camera_from_map);
    correction_.keyframes.push_back({id(view), old * new_from_old.Inverse()});
  }
  SyntheticScene scene_;
  Map map_;
  MapCorrection correction_;
};

TEST_F(MapCorrectionTest, ASimilarityOfAllKeepsEveryReprojection) {
  const Map before = map_;
  const Sim3d new_from_old(1.7, ExpSO3({0.1, -0.3, 0.2}), {1, 2, 3});
  for (size_t k = 0; k < scene_.views.size(); ++k) AddCorrected(k, new_from_old);
  ASSERT_TRUE(ApplyMapCorrection(correction_, &map_).ok());
  for (const auto& [point_id, point] : map_.points()) {
    const Eigen::Vector3d moved = new_from_old * before.point(point_id).position_in_map.cast<double>();
    EXPECT_LT((point.position_in_map.cast<double>() - moved).norm(), 1e-5);
    for (const Observation& o : point.observations) {
      const KeyFrame& keyframe = map_.keyframe(o.keyframe);
      const Eigen::Vector2d pixel =
          keyframe.data->camera.Project(keyframe.camera_from_map * point.position_in_map.cast<double>());
      EXPECT_LT((pixel - keyframe.data->features.pixels_px[o.feature].cast<double>()).norm(), 1e-2);
    }
  }
  EXPECT_THAT(ValidateMap(map_), IsEmpty());
}

TEST_F(MapCorrectionTest, YoungerKeyFramesAndPointsFollow) {
  const Map before = map_;
  const Sim3d new_from_old(0.5, ExpSO3({0, 0.2, 0}), {0, 1, 0});
  for (size_t k = 0; k < 4; ++k) AddCorrected(k, new_from_old);  // 4 and 5 came after the snapshot
  ASSERT_TRUE(ApplyMapCorrection(correction_, &map_).ok());
  for (size_t k = 0; k < scene_.views.size(); ++k) {
    const Rigid3d expected = TransformPose(before.keyframe(id(k)).camera_from_map, new_from_old);
    const Rigid3d difference = map_.keyframe(id(k)).camera_from_map * expected.Inverse();
    EXPECT_LT(LogSE3(difference).norm(), 1e-9) << "view " << k;
  }
}

TEST_F(MapCorrectionTest, TakesPointsAndMerges) {
  AddCorrected(0, Sim3d());
  const auto ids = map_.SortedPointIds();
  correction_.points.push_back({ids[0], Eigen::Vector3f(1, 2, 3)});
  correction_.points.push_back({MapPointId(8, 8, 8), Eigen::Vector3f(1, 2, 3)});
  correction_.merges = {{ids[1], ids[2]}, {MapPointId(8, 8, 8), ids[2]}, {ids[1], ids[3]}};
  const auto merged = ApplyMapCorrection(correction_, &map_);
  ASSERT_TRUE(merged.ok());
  EXPECT_THAT(*merged, ::testing::ElementsAre(std::make_pair(ids[1], ids[2])));
  EXPECT_EQ(map_.point(ids[0]).position_in_map, Eigen::Vector3f(1, 2, 3));
  EXPECT_EQ(map_.FindPoint(ids[1]), nullptr);
  EXPECT_THAT(ValidateMap(map_), IsEmpty());
}

TEST_F(MapCorrectionTest, PointsFollowTheNearestKeyFrameThatSeesThem) {
  const Map before = map_;
  // The first and the last two cameras move apart; each pulls what it is nearest to.
  const Sim3d left(1, Eigen::Quaterniond::Identity(), {-1, 0, 0}), right(1, Eigen::Quaterniond::Identity(), {1, 0, 0});
  for (size_t k = 0; k < scene_.views.size(); ++k) AddCorrected(k, k < 3 ? left : right);
  ASSERT_TRUE(ApplyMapCorrection(correction_, &map_).ok());
  int to_the_left = 0;
  for (const auto& [point_id, point] : before.points()) {
    KeyFrameId nearest;
    float least = 1e9f;
    for (const Observation& o : point.observations) {
      const Eigen::Vector3d centre = before.keyframe(o.keyframe).camera_from_map.TargetOriginInSource();
      const float distance = (centre.cast<float>() - point.position_in_map).norm();
      if (distance >= least) continue;
      nearest = o.keyframe;
      least = distance;
    }
    const float expected = nearest < id(3) ? -1 : 1;
    to_the_left += expected < 0;
    EXPECT_NEAR(map_.point(point_id).position_in_map.x() - point.position_in_map.x(), expected, 1e-5f);
  }
  EXPECT_GT(to_the_left, 50);
  EXPECT_LT(to_the_left, static_cast<int>(map_.points().size()) - 50);
}

TEST_F(MapCorrectionTest, AddsObservationsAndPassesOverThoseThatDoNotFit) {
  AddCorrected(0, Sim3d());
  MapPointId point;
  for (const MapPointId candidate : map_.SortedPointIds()) {
    if (map_.point(candidate).observations.size() > 3) point = candidate;
  }
  const Observation observation = map_.point(point).observations[1];
  map_.RemoveObservation(point, observation.keyframe);
  const Observation other = map_.point(point).observations[0];
  correction_.observations = {{point, observation},                                      // to be added
                              {point, Observation{observation.keyframe, 1000000}},       // no such feature
                              {point, Observation{KeyFrameId(8, 8, 8), 0}},              // no such keyframe
                              {MapPointId(8, 8, 8), Observation{other.keyframe, 0}},     // no such point
                              {point, Observation{other.keyframe, other.feature + 1}}};  // seen there already
  ASSERT_TRUE(ApplyMapCorrection(correction_, &map_).ok());
  ASSERT_NE(map_.point(point).FindObservation(observation.keyframe), nullptr);
  EXPECT_EQ(map_.point(point).FindObservation(observation.keyframe)->feature, observation.feature);
  EXPECT_EQ(map_.point(point).FindObservation(other.keyframe)->feature, other.feature);
  EXPECT_THAT(ValidateMap(map_), IsEmpty());
}

TEST_F(MapCorrectionTest, AnObservationOfAMergedPointComesAfterTheMerge) {
  AddCorrected(0, Sim3d());
  const auto ids = map_.SortedPointIds();
  const KeyFrameId seen_by = map_.point(ids[1]).observations.front().keyframe;
  uint32_t free_feature = 0;
  while (map_.keyframe(seen_by).landmarks[free_feature].IsValid()) ++free_feature;
  map_.RemoveObservation(ids[1], seen_by);
  map_.RemoveObservation(ids[2], seen_by);
  correction_.merges = {{ids[1], ids[2]}};
  correction_.observations = {{ids[2], Observation{seen_by, free_feature}}};
  ASSERT_TRUE(ApplyMapCorrection(correction_, &map_).ok());
  ASSERT_NE(map_.point(ids[2]).FindObservation(seen_by), nullptr);
  EXPECT_EQ(map_.point(ids[2]).FindObservation(seen_by)->feature, free_feature);
}

TEST_F(MapCorrectionTest, RefusesWhatDoesNotFit) {
  AddCorrected(0, Sim3d());
  const auto refuses = [&](const std::function<void(MapCorrection*)>& spoil, const std::string& because) {
    MapCorrection spoilt = correction_;
    spoil(&spoilt);
    const uint64_t before = HashMap(map_);
    const auto result = ApplyMapCorrection(spoilt, &map_);
    ASSERT_FALSE(result.ok()) << because;
    EXPECT_THAT(result.error().message, HasSubstr(because));
    EXPECT_EQ(HashMap(map_), before);
  };
  refuses([](MapCorrection* c) { c->map = MapId(4, 4, 4); }, "the map here");
  refuses([](MapCorrection* c) { c->epoch = 77; }, "epoch 77");
  refuses([](MapCorrection* c) { c->made_from_revision = 999; }, "revision 999");
  refuses([](MapCorrection* c) { c->keyframes[0].camera_from_map.scale = 0; }, "not a similarity");
  refuses(
      [](MapCorrection* c) {
        c->keyframes[0].camera_from_map.translation.x() = std::numeric_limits<double>::quiet_NaN();
      },
      "not a similarity");
  refuses(
      [](MapCorrection* c) {
        c->points.push_back({MapPointId(1, 1, 1), Eigen::Vector3f::Constant(1.0f / 0.0f)});
      },
      "not finite");
  refuses([](MapCorrection* c) { c->keyframes[0].id = KeyFrameId(4, 4, 4); }, "none of its");
  // Finite, and replicas would refuse the owner's map from then on.
  refuses([](MapCorrection* c) { c->points.push_back({MapPointId(1, 1, 1), {2e9f, 0, 0}}); }, "beyond any map");
  refuses([](MapCorrection* c) { c->keyframes[0].camera_from_map.translation.x() = 1e300; }, "beyond any map");
  refuses([](MapCorrection* c) { c->keyframes[0].camera_from_map.scale = 1e-300; }, "beyond any map");
}

}  // namespace
}  // namespace portolan
