#include "testing/map_builder.h"

#include <gmock/gmock.h>

#include "testing/broken_maps.h"
#include "testing/matchers.h"

namespace portolan {
namespace {

using testing::Contains;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;

SyntheticScene MakeScene() {
  SyntheticSceneOptions options;
  options.num_views = 6;
  options.num_landmarks = 200;
  options.num_clutter = 20;
  options.outlier_ratio = 0.1;
  return MakeSyntheticScene(options);
}

TEST(BuildMap, IsValidAndNearItsScene) {
  const SyntheticScene scene = MakeScene();
  const Map map = BuildMap(scene);
  EXPECT_THAT(ValidateMap(map), IsEmpty());
  EXPECT_EQ(map.keyframes().size(), 6u);
  EXPECT_GT(map.points().size(), 120u);
  EXPECT_THAT(map, MapNear(scene, MapTolerance{1e-6, 1e-6, 1e-5}));  // points are floats
}

TEST(BuildMap, IsNearItsSceneInAnyFrameAndScale) {
  const SyntheticScene scene = MakeScene();
  MapBuilderOptions options;
  options.num_keyframes = 4;
  options.map_from_world = Sim3d(3.0, ExpSO3({0.3, -0.8, 0.2}), {5, 6, 7});
  const Map map = BuildMap(scene, options);
  EXPECT_EQ(map.keyframes().size(), 4u);
  EXPECT_THAT(map, MapNear(scene, MapTolerance{1e-5, 1e-5, 1e-4}));
  const MapError error = CompareWithScene(map, scene);
  EXPECT_THAT(error.truth_from_map, Sim3Near(options.map_from_world.Inverse(), PoseTolerance{1e-5, 1e-4}, 1e-5));
}

TEST(MapNear, SeesOnePoseOrPointThatIsWrong) {
  const SyntheticScene scene = MakeScene();
  const Map good = BuildMap(scene);
  const MapTolerance tolerance;
  Map moved = good;
  const KeyFrameId second = scene.views[1].data->id;
  moved.SetPose(second, Rigid3d(Eigen::Quaterniond::Identity(), {0.01, 0, 0}) * good.keyframe(second).camera_from_map);
  EXPECT_THAT(moved, Not(MapNear(scene, tolerance)));
  EXPECT_THAT(moved, Not(MapNear(good, tolerance)));
  Map turned = good;
  turned.SetPose(second,
                 Rigid3d(ExpSO3({0, 0, 0.01}), Eigen::Vector3d::Zero()) * good.keyframe(second).camera_from_map);
  EXPECT_THAT(turned, Not(MapNear(scene, tolerance)));
  Map bent = good;
  const MapPointId point = good.SortedPointIds()[7];
  bent.SetPosition(point, good.point(point).position_in_map + Eigen::Vector3f(0, 0.1f, 0));
  EXPECT_THAT(bent, Not(MapNear(scene, tolerance)));
  EXPECT_THAT(Map(), Not(MapNear(scene, tolerance)));
  EXPECT_THAT(good, MapNear(good, tolerance));
}

TEST(BuildMap, NoiseIsAsLargeAsOrdered) {
  const SyntheticScene scene = MakeScene();
  MapBuilderOptions options;
  options.point_sigma = 0.05;
  const MapError error = CompareWithScene(BuildMap(scene, options), scene);
  EXPECT_NEAR(error.median_point, 1.538 * 0.05, 0.015);  // median of the norm of a 3D gaussian: 1.538 sigma
  EXPECT_LT(error.max_point, 0.3);
}

TEST(RigidNear, HasBothTolerances) {
  const Rigid3d a(ExpSO3({0.1, 0.2, 0.3}), {1, 2, 3});
  EXPECT_THAT(a, RigidNear(a, PoseTolerance{0, 0}));
  EXPECT_THAT(a * Rigid3d(ExpSO3({0.01, 0, 0}), {0, 0, 0}), Not(RigidNear(a, PoseTolerance{0.009, 1})));
  EXPECT_THAT(Rigid3d(a.rotation, {1, 2, 3.1}), Not(RigidNear(a, PoseTolerance{1, 0.09})));
}

/// A replica that holds the first four views, and what it knows of data.
class BrokenDeltaTest : public testing::Test {
 protected:
  BrokenDeltaTest() : scene_(MakeScene()), map_(BuildMap(scene_, FourKeyFrames())) {
    static_cast<void>(map_.TakeDelta());
  }
  static MapBuilderOptions FourKeyFrames() {
    MapBuilderOptions options;
    options.num_keyframes = 4;
    return options;
  }
  const SyntheticScene scene_;
  Map map_;
};

TEST_F(BrokenDeltaTest, TheGoodDeltaIsApplied) {
  const Status status = map_.Apply(MakeGoodDelta(map_, scene_, 4), DataOf(scene_));
  ASSERT_TRUE(status.ok()) << status.error().message;
  EXPECT_THAT(ValidateMap(map_), IsEmpty());
  EXPECT_EQ(map_.keyframes().size(), 5u);
}

TEST_F(BrokenDeltaTest, EachBrokenOneIsRefusedAndChangesNothing) {
  const uint64_t before = HashMap(map_);
  for (const BrokenDelta& broken : MakeBrokenDeltas(map_, scene_, 4)) {
    Map replica = map_;
    EXPECT_FALSE(replica.Apply(broken.delta, DataOf(scene_)).ok()) << broken.name;
    EXPECT_EQ(HashMap(replica), before) << broken.name;
    EXPECT_EQ(replica.revision(), map_.revision()) << broken.name;
  }
}

TEST(BrokenMaps, AreAllObjectedTo) {
  for (const BrokenMap& broken : MakeBrokenMaps(MakeScene())) {
    EXPECT_THAT(ValidateMap(broken.map), Contains(HasSubstr(broken.objection))) << broken.name;
  }
}

}  // namespace
}  // namespace portolan
