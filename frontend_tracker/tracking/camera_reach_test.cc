#include "tracking/camera_reach.h"

#include <gtest/gtest.h>

#include "tracking/synthetic_frame.h"

namespace portolan {
namespace {

constexpr double kFrameS = 0.1;

/// A map of keyframes along x at depth about 5, and a camera that was tracked in it at the frames' times.
class CameraReachTest : public ::testing::Test {
 protected:
  CameraReachTest() {
    SyntheticSceneOptions options;
    options.num_views = 3;
    options.travel = 0.5;
    scene_ = MakeSyntheticScene(options);
    map_ = BuildMap(scene_);
    depth_ = map_.MedianDepth(Reference());
  }
  KeyFrameId Reference() const { return scene_.views[0].data->id; }
  static Rigid3d At(double x) { return Rigid3d(Eigen::Quaterniond::Identity(), {-x, 0, 0}); }
  static Timestamp TimeOf(uint64_t number) { return Timestamp::FromSeconds(kFrameS * static_cast<double>(number)); }
  void Track(uint64_t number, double x) {
    Frame frame;
    frame.number = number;
    frame.stamp = TimeOf(number);
    frame.camera_from_map = At(x);
    frame.reference = Reference();
    history_.Add(map_, frame, true);
  }

  SyntheticScene scene_;
  Map map_;
  double depth_ = 0;
  FrameHistory history_;
};

TEST_F(CameraReachTest, GrowsWithTimeFromWhereTheCameraWas) {
  for (uint64_t i = 0; i <= 10; ++i) Track(i, 0.01 * static_cast<double>(i));  // slow, beside what it sees
  const auto soon = ReachOfCamera(history_, map_, TimeOf(11)), later = ReachOfCamera(history_, map_, TimeOf(20));
  ASSERT_TRUE(soon && later);
  EXPECT_NEAR(soon->centre_in_map.x(), 0.1, 1e-6);
  EXPECT_NEAR(soon->radius, (0.5 + 0.5 * kFrameS) * depth_, 1e-3 * depth_);
  EXPECT_NEAR(later->radius, 1.0 * depth_, 1e-3 * depth_);
  EXPECT_TRUE(soon->Contains(At(0.1 + 0.5 * depth_)));
  EXPECT_FALSE(soon->Contains(At(0.1 + 0.65 * depth_)));
  EXPECT_FALSE(soon->Contains(At(0.1 - 0.65 * depth_)));
}

TEST_F(CameraReachTest, AFastCameraMayHaveGoneFarther) {
  const double speed = 4 * depth_;  // a second
  for (uint64_t i = 0; i <= 10; ++i) Track(i, speed * kFrameS * static_cast<double>(i));
  const auto reach = ReachOfCamera(history_, map_, TimeOf(12));
  ASSERT_TRUE(reach);
  EXPECT_NEAR(reach->radius, 0.5 * depth_ + 2 * speed * 2 * kFrameS, 1e-3 * reach->radius);
}

TEST_F(CameraReachTest, FollowsTheMap) {
  Track(1, 0.2);
  map_.SetPose(Reference(), map_.keyframe(Reference()).camera_from_map * At(3));
  const auto reach = ReachOfCamera(history_, map_, TimeOf(2));
  ASSERT_TRUE(reach);
  EXPECT_NEAR(reach->centre_in_map.x(), 3.2, 1e-6);
}

TEST_F(CameraReachTest, TellsNothingAfterLongOrOfAnotherMap) {
  EXPECT_FALSE(ReachOfCamera(history_, map_, TimeOf(1)));
  Track(1, 0);
  EXPECT_TRUE(ReachOfCamera(history_, map_, TimeOf(40)));
  EXPECT_FALSE(ReachOfCamera(history_, map_, TimeOf(42)));
  EXPECT_FALSE(ReachOfCamera(history_, Map(MapId(77)), TimeOf(2)));
}

}  // namespace
}  // namespace portolan
