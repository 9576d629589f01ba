#include "tracking/map_motion.h"

#include <gtest/gtest.h>

#include "testing/map_builder.h"

namespace portolan {
namespace {

SyntheticScene MakeScene() {
  SyntheticSceneOptions options;
  options.num_views = 4;
  return MakeSyntheticScene(options);
}

Map MapAfter(const SyntheticScene& scene, const Sim3d& map_from_world) {
  MapBuilderOptions options;
  options.map_from_world = map_from_world;
  return BuildMap(scene, options);
}

TEST(MapMotion, MeasuresTheSimilarityThatMovedTheMap) {
  const SyntheticScene scene = MakeScene();
  const Map before = MapAfter(scene, Sim3d());
  const Sim3d new_from_old(1.3, ExpSO3({0.1, -0.4, 0.2}), {3, -1, 2});
  const Map after = MapAfter(scene, new_from_old);
  const KeyFrameId keyframe = scene.views[2].data->id;

  const auto measured = MapMotion(before, keyframe).Measure(after);
  ASSERT_TRUE(measured);
  EXPECT_NEAR(measured->scale, new_from_old.scale, 1e-5);
  // A camera that was somewhere near the keyframe is where the scene around it went.
  const Rigid3d other = scene.views[3].camera_from_world;
  const Rigid3d carried = TransformPose(other, *measured), expected = TransformPose(other, new_from_old);
  EXPECT_LT((carried.translation - expected.translation).norm(), 1e-4);
  EXPECT_LT(carried.rotation.angularDistance(expected.rotation), 1e-6);
}

TEST(MapMotion, IsNoneForAKeyFrameThatIsGone) {
  const SyntheticScene scene = MakeScene();
  Map map = MapAfter(scene, Sim3d());
  const KeyFrameId keyframe = scene.views[2].data->id;
  const MapMotion motion(map, keyframe), unknown(map, KeyFrameId(0, 7, 99));
  map.RemoveKeyFrame(keyframe);
  EXPECT_FALSE(motion.Measure(map));
  EXPECT_FALSE(unknown.Measure(map));
}

TEST(MapMotion, KeepsTheScaleWhereTooFewLandmarksAreLeft) {
  const SyntheticScene scene = MakeScene();
  Map map = MapAfter(scene, Sim3d());
  const KeyFrameId keyframe = scene.views[1].data->id;
  const MapMotion motion(map, keyframe);
  for (const MapPointId id : map.SortedPointIds()) {
    if (map.points().size() > 5) map.RemovePoint(id);
  }
  const auto measured = motion.Measure(map);
  ASSERT_TRUE(measured);
  EXPECT_DOUBLE_EQ(measured->scale, 1.0);
}

}  // namespace
}  // namespace portolan
