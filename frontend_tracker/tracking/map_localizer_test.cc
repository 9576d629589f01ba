#include "tracking/map_localizer.h"

#include <gmock/gmock.h>

#include "tracking/synthetic_frame.h"

namespace portolan {
namespace {

using ::testing::IsEmpty;
using ::testing::SizeIs;

/// A camera on an arc of 10 around its landmarks; every view but one is in the map.
class MapLocalizerTest : public ::testing::Test {
 protected:
  MapLocalizerTest() {
    SyntheticSceneOptions options;
    options.motion = CameraMotion::kOrbit;
    options.num_views = 11;
    options.travel = 5;
    options.pixel_sigma_px = 0.5;
    options.num_clutter = 100;
    scene_ = MakeSyntheticScene(options);
    MapBuilderOptions builder;
    builder.num_keyframes = kView;
    map_ = BuildMap(scene_, builder);
    static_cast<void>(map_.TakeDelta());
  }
  Rigid3d Truth() const { return scene_.views[kView].camera_from_world; }

  static constexpr size_t kView = 10;
  SyntheticScene scene_;
  Map map_;
  MapLocalizer localizer_{TrackerOptions()};
};

TEST_F(MapLocalizerTest, KeyFramesInViewAreThoseThatLookAtThePlace) {
  const Rigid3d pose = scene_.views[4].camera_from_world;
  const auto keyframes = KeyFramesInView(map_, scene_.options.camera, pose, 3);
  ASSERT_THAT(keyframes, SizeIs(3));
  for (const KeyFrameId id : keyframes) {
    const double turn = map_.keyframe(id).camera_from_map.rotation.angularDistance(pose.rotation);
    EXPECT_LT(turn, 1.05);
  }
  const Rigid3d away = Rigid3d(ExpSO3({0, M_PI, 0}), Eigen::Vector3d::Zero()) * pose;
  EXPECT_THAT(KeyFramesInView(map_, scene_.options.camera, away, 3), IsEmpty());
  EXPECT_THAT(LandmarksInView(map_, scene_.options.camera, away), IsEmpty());
  EXPECT_THAT(KeyFramesInView(Map(map_.id()), scene_.options.camera, pose, 3), IsEmpty());
}

TEST_F(MapLocalizerTest, LocalisesNearARoughPose) {
  Frame frame = FrameOfView(scene_, kView);
  const Rigid3d rough = Rigid3d(ExpSO3({0.01, -0.02, 0.01}), {0.05, 0.02, -0.05}) * Truth();
  ASSERT_TRUE(localizer_.LocalizeNear(map_, rough, &frame));
  EXPECT_LT(frame.camera_from_map.rotation.angularDistance(Truth().rotation), 1.5e-3);
  EXPECT_LT((frame.camera_from_map.TargetOriginInSource() - Truth().TargetOriginInSource()).norm(), 1e-2);
  EXPECT_GE(frame.num_inliers, 30);
  EXPECT_NE(map_.FindKeyFrame(frame.reference), nullptr);
  EXPECT_LE(CountWrongLandmarks(scene_, kView, map_, frame.landmarks), frame.num_inliers / 50);
}

TEST_F(MapLocalizerTest, FailsElsewhere) {
  SyntheticSceneOptions options = scene_.options;
  options.seed = 7;
  const SyntheticScene elsewhere = MakeSyntheticScene(options);
  Frame frame = FrameOfView(elsewhere, kView);
  EXPECT_FALSE(localizer_.LocalizeNear(map_, Truth(), &frame));
  Frame right = FrameOfView(scene_, kView);
  const Rigid3d wrong = Rigid3d(ExpSO3({0, 0.6, 0}), {2, 0, 0}) * Truth();
  EXPECT_FALSE(localizer_.LocalizeNear(map_, wrong, &right));
}

}  // namespace
}  // namespace portolan
