#include "testing/lens_warp.h"

#include <gtest/gtest.h>

#include "testing/synthetic_sequence.h"

namespace portolan {
namespace {

/// A picture whose grey value is a coordinate of the pixel's ray on the plane z = 1.
cv::Mat RayPicture(const PinholeCamera& camera, int axis) {
  cv::Mat light(camera.height, camera.width, CV_32FC1);
  for (int y = 0; y < light.rows; ++y) {
    for (int x = 0; x < light.cols; ++x) {
      light.at<float>(y, x) = static_cast<float>(camera.Normalize(Eigen::Vector2d(x, y))[axis]);
    }
  }
  return light;
}

class LensWarpTest : public testing::TestWithParam<RadialResidual> {};

TEST_P(LensWarpTest, APixelShowsTheRayThatTheLensBendsToIt) {
  const PinholeCamera camera = MakeSyntheticCamera(320, 240);
  const LensWarp warp(camera, GetParam());
  const cv::Mat ray_x = warp.Apply(RayPicture(warp.ideal_camera(), 0));
  const cv::Mat ray_y = warp.Apply(RayPicture(warp.ideal_camera(), 1));
  ASSERT_EQ(ray_x.size(), cv::Size(320, 240));
  for (int y = 0; y < camera.height; ++y) {
    for (int x = 0; x < camera.width; ++x) {
      const Eigen::Vector2d ideal_xy(ray_x.at<float>(y, x), ray_y.at<float>(y, x));
      const Eigen::Vector2d bent_px = camera.Project(GetParam().Distort(ideal_xy).homogeneous());
      // OpenCV's cubic kernel takes a ramp for up to 0.08 pixels off.
      ASSERT_LT((bent_px - Eigen::Vector2d(x, y)).norm(), 0.1) << x << ", " << y;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Lenses, LensWarpTest,
                         testing::Values(RadialResidual{}, RadialResidual{-0.12, 0.03}, RadialResidual{0.1, 0},
                                         RadialResidual{0.05, -0.1}));

TEST(LensWarp, RefusesALensThatFoldsThePictureOrThrowsItFar) {
  const PinholeCamera camera = MakeSyntheticCamera(320, 240);
  EXPECT_TRUE(LensWarp::IsPossible(camera, {-0.1, 0}));
  EXPECT_FALSE(LensWarp::IsPossible(camera, {-1, 0}));
  EXPECT_FALSE(LensWarp::IsPossible(camera, {50, 0}));
  EXPECT_FALSE(LensWarp::IsPossible(camera, {std::nan(""), 0}));
}

}  // namespace
}  // namespace portolan
