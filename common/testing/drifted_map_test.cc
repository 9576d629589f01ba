#include "testing/drifted_map.h"

#include <gmock/gmock.h>

#include <set>

#include "testing/matchers.h"

namespace portolan {
namespace {

using testing::IsEmpty;
using testing::Not;

SyntheticScene MakeStreet() {
  SyntheticSceneOptions options;
  options.landmarks = LandmarkLayout::kStreet;
  options.motion = CameraMotion::kStreetLap;
  options.num_landmarks = 1500;
  options.num_views = 55;
  options.lap = 20;
  options.travel = 22;
  options.sight = 6;
  return MakeSyntheticScene(options);
}

TEST(DriftedMap, WithoutDriftIsTheScene) {
  const SyntheticScene scene = MakeStreet();
  const DriftedMap drifted = BuildDriftedMap(scene, DriftOptions());
  EXPECT_THAT(ValidateMap(drifted.map), IsEmpty());
  EXPECT_THAT(drifted.map, MapNear(scene, MapTolerance{1e-5, 1e-5, 1e-4}));
  EXPECT_LT(CompareWithScene(drifted.map, scene).camera_rmse, 1e-5);
}

TEST(DriftedMap, ARevisitIsNotKnown) {
  const SyntheticScene scene = MakeStreet();
  const DriftedMap drifted = BuildDriftedMap(scene, DriftOptions());
  const KeyFrameId last = scene.views[54].data->id;
  EXPECT_EQ(drifted.map.Covisibility(last, scene.views[4].data->id), 0);
  EXPECT_GT(drifted.TrueSightings(scene, 54, 4).size(), 50u);
}

TEST(DriftedMap, IsConsistentAroundEachViewAndWrongAsAWhole) {
  const SyntheticScene scene = MakeStreet();
  DriftOptions options;
  options.scale_step = 0.99;
  options.turn_step = {0, 0.002, 0};
  const DriftedMap drifted = BuildDriftedMap(scene, options);
  EXPECT_THAT(drifted.map, Not(MapNear(scene, MapTolerance{0.05, 0.5, 1.0})));
  EXPECT_GT(CompareWithScene(drifted.map, scene).camera_rmse, 0.1);
  const size_t a = 40, b = 42;
  const Sim3d expected = drifted.TrueSimilarity(scene, a, b);
  const Rigid3d in_map = drifted.map.keyframe(scene.views[a].data->id).camera_from_map *
                         drifted.map.keyframe(scene.views[b].data->id).camera_from_map.Inverse();
  EXPECT_THAT(Sim3d(in_map), Sim3Near(expected, PoseTolerance{0.005, 0.05}, 0.03));
}

TEST(DriftedMap, SightingsOfARevisitAgreeWithTheTrueSimilarity) {
  const SyntheticScene scene = MakeStreet();
  DriftOptions options;
  options.scale_step = 0.99;
  const DriftedMap drifted = BuildDriftedMap(scene, options);
  const Sim3d a_from_b = drifted.TrueSimilarity(scene, 54, 4);
  const KeyFrame& a = drifted.map.keyframe(scene.views[54].data->id);
  const KeyFrame& b = drifted.map.keyframe(scene.views[4].data->id);
  for (const auto& [feature, point] : drifted.TrueSightings(scene, 54, 4)) {
    const Eigen::Vector3d in_b = b.camera_from_map * drifted.map.point(point).position_in_map.cast<double>();
    const Eigen::Vector2d pixel = a.data->camera.Project(a_from_b * in_b);
    EXPECT_LT((pixel - a.data->features.pixels_px[feature].cast<double>()).norm(), 30.0);  // 5 % of the distance
  }
}

}  // namespace
}  // namespace portolan
