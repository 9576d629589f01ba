#include "geometry/camera_model.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <opencv2/calib3d.hpp>

#include "geometry/geometry_test_utils.h"

namespace portolan {
namespace {

using testing::HasSubstr;

CameraModel Undistorted() {
  CameraModel model;
  model.pinhole = TestCamera();
  return model;
}

/// EuRoC's first camera.
CameraModel RadialTangential() {
  CameraModel model;
  model.pinhole = PinholeCamera{458.654, 457.296, 367.215, 248.375, 752, 480};
  model.distortion = Distortion::kRadialTangential;
  model.coefficients = {-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05, 0};
  return model;
}

/// Like TUM VI's cameras.
CameraModel Fisheye() {
  CameraModel model;
  model.pinhole = PinholeCamera{190.978, 190.973, 254.932, 256.897, 512, 512};
  model.distortion = Distortion::kKannalaBrandt4;
  model.coefficients = {0.0034824, 0.0007150, -0.0020532, 0.00020294, 0};
  return model;
}

/// KITTI's rectified camera, with what its calibration leaves.
CameraModel WithResidual(CameraModel model) {
  model.residual = {0.026, -0.012};
  return model;
}
CameraModel UndistortedWithResidual() {
  return WithResidual(Undistorted());
}
CameraModel RadialTangentialWithResidual() {
  return WithResidual(RadialTangential());
}
CameraModel FisheyeWithResidual() {
  CameraModel model = Fisheye();
  model.residual = {0.004, -0.0003};  // its pixels reach far out on the plane z = 1
  return model;
}

TEST(PinholeCameraTest, UnprojectInvertsProject) {
  Random random(1);
  const PinholeCamera camera = TestCamera();
  for (int i = 0; i < 20; ++i) {
    const Eigen::Vector3d point = RandomPointInView(&random, camera, 1, 10);
    EXPECT_THAT(Eigen::Vector3d(camera.Unproject(camera.Project(point)) * point.z()), VectorNear(point, 1e-10));
  }
}

TEST(PinholeCameraTest, ProjectsByItsMatrix) {
  const PinholeCamera camera = TestCamera();
  const Eigen::Vector3d point(0.3, -0.2, 2);
  EXPECT_THAT(camera.Project(point), VectorNear(Eigen::Vector2d((camera.K() * point).hnormalized()), 1e-10));
}

TEST(PinholeCameraTest, ContainsItsCornersAndNothingBeyond) {
  const PinholeCamera camera = TestCamera();
  EXPECT_TRUE(camera.Contains({0, 0}));
  EXPECT_TRUE(camera.Contains({639, 479}));
  EXPECT_FALSE(camera.Contains({639.1, 479}));
  EXPECT_FALSE(camera.Contains({-0.1, 3}));
  EXPECT_FALSE(camera.Contains({std::nan(""), 3}));
}

class LensTest : public testing::TestWithParam<std::function<CameraModel()>> {};

TEST_P(LensTest, UndistortInvertsDistortOverTheWholeImage) {
  const CameraModel model = GetParam()();
  int checked = 0;
  for (int y = 0; y < model.pinhole.height; y += 20) {
    for (int x = 0; x < model.pinhole.width; x += 20) {
      const cv::Point2f ideal = model.Undistort({cv::Point2f(x, y)})[0];
      if (std::isnan(ideal.x)) continue;  // fisheye corners
      const Eigen::Vector2d back = model.Distort(model.pinhole.Unproject({ideal.x, ideal.y}));
      EXPECT_THAT(back, VectorNear(Eigen::Vector2d(x, y), 1e-3));
      ++checked;
    }
  }
  EXPECT_GT(checked, 500);
}

TEST_P(LensTest, PrincipalPointStays) {
  const CameraModel model = GetParam()();
  const cv::Point2f centre(static_cast<float>(model.pinhole.cx), static_cast<float>(model.pinhole.cy));
  const cv::Point2f ideal = model.Undistort({centre})[0];
  EXPECT_NEAR(ideal.x, centre.x, 1e-4);
  EXPECT_NEAR(ideal.y, centre.y, 1e-4);
}

TEST_P(LensTest, SoundModelPassesItsCheck) {
  EXPECT_TRUE(GetParam()().Check().ok());
}

INSTANTIATE_TEST_SUITE_P(AllLenses, LensTest,
                         testing::Values(Undistorted, RadialTangential, Fisheye, UndistortedWithResidual,
                                         RadialTangentialWithResidual, FisheyeWithResidual));

TEST(CameraModelTest, ResidualComesOnTopOfTheLens) {
  CameraModel model;
  model.pinhole = {500, 400, 320, 240, 640, 480};
  EXPECT_TRUE(model.IsIdeal());
  model.residual = {0.1, -0.05};
  EXPECT_FALSE(model.IsIdeal());
  const double radial = 1 + 0.1 * 0.25 - 0.05 * 0.0625;  // at r = 0.5
  EXPECT_THAT(model.Distort({0.3, 0.4, 1}),
              VectorNear(Eigen::Vector2d(500 * 0.3 * radial + 320, 400 * 0.4 * radial + 240), 1e-9));
}

TEST(CameraModelTest, RadialTangentialAgreesWithOpenCv) {
  CameraModel model = RadialTangential();
  model.coefficients = {-0.28, 0.07, 0.002, -0.003, 0.01};
  const Eigen::Vector3d point(0.4, -0.3, 1.5);
  std::vector<cv::Point2d> expected;
  cv::projectPoints(std::vector<cv::Point3d>{{point.x(), point.y(), point.z()}}, cv::Vec3d(), cv::Vec3d(),
                    cv::Matx33d(model.pinhole.fx, 0, model.pinhole.cx, 0, model.pinhole.fy, model.pinhole.cy, 0, 0, 1),
                    std::vector<double>(model.coefficients.begin(), model.coefficients.end()), expected);
  EXPECT_THAT(model.Distort(point), VectorNear(Eigen::Vector2d(expected[0].x, expected[0].y), 1e-9));
}

TEST(CameraModelTest, FisheyeAgreesWithOpenCv) {
  const CameraModel model = Fisheye();
  const Eigen::Vector3d point(1.4, -1.3, 1.5);
  std::vector<cv::Point2d> expected;
  cv::fisheye::projectPoints(
      std::vector<cv::Point3d>{{point.x(), point.y(), point.z()}}, expected, cv::Vec3d(), cv::Vec3d(),
      cv::Matx33d(model.pinhole.fx, 0, model.pinhole.cx, 0, model.pinhole.fy, model.pinhole.cy, 0, 0, 1),
      std::vector<double>(model.coefficients.begin(), model.coefficients.begin() + 4));
  EXPECT_THAT(model.Distort(point), VectorNear(Eigen::Vector2d(expected[0].x, expected[0].y), 1e-9));
}

TEST(CameraModelTest, FisheyeRaysBeyondEightyDegreesHaveNoIdealPixel) {
  const CameraModel model = Fisheye();
  const auto pixel_at = [&](double degrees) {
    const double angle = degrees * M_PI / 180;
    const Eigen::Vector2d pixel = model.Distort({std::sin(angle), 0, std::cos(angle)});
    return cv::Point2f(static_cast<float>(pixel.x()), static_cast<float>(pixel.y()));
  };
  EXPECT_FALSE(std::isnan(model.Undistort({pixel_at(79)})[0].x));
  EXPECT_TRUE(std::isnan(model.Undistort({pixel_at(81)})[0].x));
}

TEST(CameraModelTest, PixelOutsideTheLensModelHasNoIdealPixel) {
  CameraModel model = RadialTangential();
  model.coefficients = {-0.3, 0, 0, 0, 0};  // radius r (1 - 0.3 r^2) never exceeds 0.70 focal lengths
  EXPECT_TRUE(std::isnan(model.Undistort({cv::Point2f(367.215F + 0.75F * 458.654F, 248.375F)})[0].x));
}

TEST(CameraModelTest, CheckNamesTheFieldAndItsValue) {
  const std::vector<std::pair<std::string, std::function<void(CameraModel*)>>> cases = {
      {"fx", [](CameraModel* m) { m->pinhole.fx = -1; }},
      {"fy", [](CameraModel* m) { m->pinhole.fy = std::nan(""); }},
      {"width", [](CameraModel* m) { m->pinhole.width = 0; }},
      {"height", [](CameraModel* m) { m->pinhole.height = -480; }},
      {"cx", [](CameraModel* m) { m->pinhole.cx = 1000; }},
      {"cy", [](CameraModel* m) { m->pinhole.cy = -3; }},
      {"coefficient 2", [](CameraModel* m) { m->coefficients[2] = std::numeric_limits<double>::infinity(); }},
      {"fps", [](CameraModel* m) { m->fps = -30; }}};
  for (const auto& [field, spoil] : cases) {
    CameraModel model = RadialTangential();
    spoil(&model);
    const Status status = model.Check();
    ASSERT_FALSE(status.ok()) << field;
    EXPECT_THAT(status.error().message, HasSubstr(field));
    EXPECT_THAT(status.error().message, HasSubstr("expected"));
  }
}

}  // namespace
}  // namespace portolan
