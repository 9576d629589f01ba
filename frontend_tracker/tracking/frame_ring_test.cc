#include "tracking/frame_ring.h"

#include <gmock/gmock.h>

#include "testing/matchers.h"
#include "tracking/synthetic_frame.h"

namespace portolan {
namespace {

using ::testing::IsEmpty;
using ::testing::SizeIs;

const MapId kMap(0, 1, 1), kOther(0, 1, 2);

/// A camera that moves sideways by 0.1 a frame, 5 before its landmarks: 10 px each at their depth, less as it keeps
/// them in the middle.
class FrameRingTest : public ::testing::Test {
 protected:
  FrameRingTest() {
    SyntheticSceneOptions options;
    options.num_views = 12;
    options.travel = 1.1;
    scene_ = MakeSyntheticScene(options);
    MapBuilderOptions builder;
    map_ = BuildMap(scene_, builder);
  }
  Frame Tracked(size_t view, MapId map = kMap) const {
    Frame frame = FrameOfView(scene_, view);
    frame.map = map;
    frame.camera_from_map = scene_.views[view].camera_from_world;
    frame.landmarks = TrueLandmarks(scene_, view, map_);
    return frame;
  }

  SyntheticScene scene_;
  Map map_;
  FrameRing ring_{10};
};

TEST_F(FrameRingTest, KeepsTheLastFramesOfOneMap) {
  for (size_t view = 0; view < 12; ++view) ring_.Add(Tracked(view));
  ASSERT_THAT(ring_.frames(), SizeIs(10));
  EXPECT_EQ(ring_.frames().front().number, 2u);
  ring_.Add(Tracked(3, kOther));
  ASSERT_THAT(ring_.frames(), SizeIs(1));
  ring_.Clear();
  EXPECT_THAT(ring_.frames(), IsEmpty());
  EXPECT_THAT(ring_.Overlapping(1, 10), IsEmpty());
}

TEST_F(FrameRingTest, FailedFramesAreThoseSinceTheLastTracked) {
  ring_.Add(Tracked(0));
  ring_.AddFailed(FrameOfView(scene_, 1));
  ring_.AddFailed(FrameOfView(scene_, 2));
  EXPECT_THAT(ring_.failed(), SizeIs(2));
  ring_.Add(Tracked(3));
  EXPECT_THAT(ring_.failed(), IsEmpty());
}

TEST_F(FrameRingTest, MotionIsThatOfTheTranslationAlone) {
  size_t common = 0;
  EXPECT_NEAR(CompensatedMotionPx(Tracked(0), Tracked(0), &common), 0, 1e-3);
  EXPECT_GT(common, 100u);
  const double near_px = CompensatedMotionPx(Tracked(0), Tracked(2), &common);
  const double far_px = CompensatedMotionPx(Tracked(0), Tracked(6), &common);
  EXPECT_NEAR(near_px, 500 * 0.2 / 5, 8);  // f * distance / depth, of depths from 2.5 to 7.5
  EXPECT_NEAR(far_px / near_px, 3, 0.3);
  // A turn on the spot is none: features where they were, but for the turn.
  SyntheticSceneOptions turning;
  turning.motion = CameraMotion::kPureRotation;
  turning.travel = 1;
  turning.num_views = 3;
  const SyntheticScene turned = MakeSyntheticScene(turning);
  const Map map = BuildMap(turned, MapBuilderOptions());
  Frame a = FrameOfView(turned, 0), b = FrameOfView(turned, 2);
  a.landmarks = TrueLandmarks(turned, 0, map);
  b.landmarks = TrueLandmarks(turned, 2, map);
  a.camera_from_map = turned.views[0].camera_from_world;
  b.camera_from_map = turned.views[2].camera_from_world;
  EXPECT_NEAR(CompensatedMotionPx(a, b, &common), 0, 1e-2);
}

TEST_F(FrameRingTest, BeginsWhereTheCameraHasMovedJustEnough) {
  for (size_t view = 0; view < 10; ++view) ring_.Add(Tracked(view));
  size_t common = 0;
  const double wanted = CompensatedMotionPx(Tracked(6), Tracked(9), &common) - 0.1;
  const std::vector<Frame> frames = ring_.Overlapping(wanted, 20);
  ASSERT_THAT(frames, SizeIs(4));
  EXPECT_EQ(frames.front().number, 6u);
  EXPECT_EQ(frames.back().number, 9u);
  EXPECT_THAT(ring_.Overlapping(1e4, 20), SizeIs(10)) << "as far back as there is";
  EXPECT_THAT(ring_.Overlapping(1e4, 100000), SizeIs(1)) << "nothing in common";
}

TEST_F(FrameRingTest, MovesWithTheMap) {
  ring_.Add(Tracked(4));
  ring_.AddFailed(Tracked(5));
  const Sim3d moved(2, ExpSO3({0, 0.5, 0}), {1, 0, 0});
  ring_.MoveWithMap(kOther, moved);
  EXPECT_EQ(ring_.frames().back().map, kOther);
  EXPECT_THAT(ring_.frames().back().camera_from_map,
              RigidNear(TransformPose(scene_.views[4].camera_from_world, moved), PoseTolerance()));
  EXPECT_THAT(ring_.failed().back().camera_from_map,
              RigidNear(TransformPose(scene_.views[5].camera_from_world, moved), PoseTolerance()));
}

}  // namespace
}  // namespace portolan
