#include "tracking/rotation_estimator.h"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/imgproc.hpp>

#include "base/random.h"
#include "geometry/rigid3.h"

namespace portolan {
namespace {

const PinholeCamera kCamera{450, 450, 319.5, 239.5, 640, 480};

/// A sum of plane waves of wavelengths from 60 to 300 pixels: a texture that is known between pixels too. Grey levels
/// about 128.
class Waves {
 public:
  explicit Waves(uint64_t seed) {
    Random random(seed);
    for (int i = 0; i < 20; ++i) {
      const double angle = random.Uniform(0, 2 * M_PI), length = random.Uniform(60, 300);
      waves_.push_back(
          {2 * M_PI / length * std::cos(angle), 2 * M_PI / length * std::sin(angle), random.Uniform(0, 2 * M_PI)});
    }
  }
  double operator()(double x, double y) const {
    double sum = 128;
    for (const Eigen::Vector3d& w : waves_) sum += 12 * std::sin(w.x() * x + w.y() * y + w.z());
    return std::clamp(sum, 0.0, 255.0);
  }

 private:
  std::vector<Eigen::Vector3d> waves_;
};

/// The image in which `source_of(pixel)` of the waves appears at each pixel.
template <class SourceOf>
cv::Mat Paint(const Waves& waves, const SourceOf& source_of) {
  cv::Mat image(kCamera.height, kCamera.width, CV_8UC1);
  for (int y = 0; y < image.rows; ++y) {
    for (int x = 0; x < image.cols; ++x) {
      const Eigen::Vector2d source = source_of(Eigen::Vector2d(x, y));
      image.at<uchar>(y, x) = cv::saturate_cast<uchar>(waves(source.x(), source.y()));
    }
  }
  return image;
}
cv::Mat PaintReference(const Waves& waves) {
  return Paint(waves, [](const Eigen::Vector2d& p) { return p; });
}
/// The reference's scene from a camera turned on the spot: homography K R K^-1.
cv::Mat PaintTurned(const Waves& waves, const Eigen::Quaterniond& current_from_reference) {
  return Paint(waves, [&](const Eigen::Vector2d& p) {
    return kCamera.Project(current_from_reference.conjugate() * kCamera.Unproject(p));
  });
}

struct PlaneCase {
  double x_px, y_px, angle_deg;  // full pixels
};

class ImageMotionTest : public ::testing::TestWithParam<PlaneCase> {};

TEST_P(ImageMotionTest, EsmRecoversAPlaneMotion) {
  const Waves waves(3);
  const double angle = GetParam().angle_deg * M_PI / 180;
  const Eigen::Vector2d centre(319.5, 239.5), shift(GetParam().x_px, GetParam().y_px);
  const Eigen::Rotation2Dd back(-angle);
  const SmallImage reference = RotationEstimator::Shrink(PaintReference(waves));
  const SmallImage current = RotationEstimator::Shrink(
      Paint(waves, [&](const Eigen::Vector2d& p) { return Eigen::Vector2d(centre + back * (p - centre - shift)); }));
  const ImageMotion motion = RotationEstimator(kCamera).EstimateImageMotion(reference, current);
  ASSERT_TRUE(motion.converged);
  EXPECT_NEAR(motion.angle_rad, angle, 2e-3);
  // Within half a pixel of the full image, 0.08 of the small one.
  EXPECT_LT((motion.translation_px * reference.scale - shift).norm(), 0.5);
  EXPECT_LT(motion.rms, 2);
}

INSTANTIATE_TEST_SUITE_P(Motions, ImageMotionTest,
                         ::testing::Values(PlaneCase{0, 0, 0}, PlaneCase{10, -6, 0}, PlaneCase{0, 0, 4},
                                           PlaneCase{-25, 14, -3}, PlaneCase{40, 0, 2}, PlaneCase{1.5, 0.7, 0.2}));

class TurnTest : public ::testing::TestWithParam<Eigen::Vector3d> {};

TEST_P(TurnTest, RecoversTheCamerasRotation) {
  const Waves waves(5);
  const Eigen::Quaterniond truth = ExpSO3(GetParam());
  const RotationEstimator estimator(kCamera);
  const auto estimate =
      estimator.EstimateRotation(RotationEstimator::Shrink(PaintReference(waves)),
                                 RotationEstimator::Shrink(PaintTurned(waves, truth)), Eigen::Quaterniond::Identity());
  ASSERT_TRUE(estimate.ok);
  // A plane motion is no homography: the error grows with the square of the turn. A tenth of a degree plus 4 % of the
  // turn.
  EXPECT_LT(estimate.current_from_reference.angularDistance(truth), 0.0017 + 0.04 * GetParam().norm());
}

INSTANTIATE_TEST_SUITE_P(Turns, TurnTest,
                         ::testing::Values(Eigen::Vector3d(0, 0, 0), Eigen::Vector3d(0.03, 0, 0),
                                           Eigen::Vector3d(0, -0.04, 0), Eigen::Vector3d(0, 0, 0.06),
                                           Eigen::Vector3d(0.02, 0.05, -0.03)));

TEST(RotationEstimator, ToleratesAnExposureOffset) {
  const Waves waves(6);
  const Eigen::Quaterniond truth = ExpSO3({0.01, 0.03, 0.01});
  const SmallImage reference = RotationEstimator::Shrink(PaintReference(waves));
  SmallImage brighter = RotationEstimator::Shrink(PaintTurned(waves, truth));
  const RotationEstimator estimator(kCamera);
  const auto before = estimator.EstimateRotation(reference, brighter, Eigen::Quaterniond::Identity());
  brighter.values += 25;
  const auto after = estimator.EstimateRotation(reference, brighter, Eigen::Quaterniond::Identity());
  ASSERT_TRUE(before.ok && after.ok);
  EXPECT_LT(after.current_from_reference.angularDistance(before.current_from_reference), 1e-3);
}

TEST(RotationEstimator, PredictionHelpsWhereTheTurnIsBeyondTheBasin) {
  const Waves waves(8);
  const Eigen::Quaterniond truth = ExpSO3({0, 0.3, 0}), predicted = ExpSO3({0, 0.27, 0});
  const SmallImage reference = RotationEstimator::Shrink(PaintReference(waves));
  const SmallImage current = RotationEstimator::Shrink(PaintTurned(waves, truth));
  const RotationEstimator estimator(kCamera);
  const auto alone = estimator.EstimateRotation(reference, current, Eigen::Quaterniond::Identity());
  EXPECT_GT(alone.current_from_reference.angularDistance(truth), 0.1);
  const auto helped = estimator.EstimateRotation(reference, current, predicted);
  ASSERT_TRUE(helped.ok);
  // What is left is the plane motion's own error, for so large a turn.
  EXPECT_LT(helped.current_from_reference.angularDistance(truth), 0.04);
}

TEST(RotationEstimator, ImagesOfDifferentThingsGiveNothing) {
  // Checkers against their negative: no motion within reach makes the two alike.
  cv::Mat a(480, 640, CV_8UC1), b;
  for (int y = 0; y < a.rows; ++y) {
    for (int x = 0; x < a.cols; ++x) a.at<uchar>(y, x) = static_cast<uchar>(x < 320 ? 0 : 255);
  }
  cv::bitwise_not(a, b);
  const RotationEstimator estimator(kCamera);
  EXPECT_FALSE(
      estimator
          .EstimateRotation(RotationEstimator::Shrink(a), RotationEstimator::Shrink(b), Eigen::Quaterniond::Identity())
          .ok);
}

TEST(RotationEstimator, BlankAndOddlySizedImagesDoNoHarm) {
  const RotationEstimator estimator(kCamera);
  const SmallImage blank = RotationEstimator::Shrink(cv::Mat(480, 640, CV_8UC1, cv::Scalar(90)));
  const auto nothing = estimator.EstimateRotation(blank, blank, Eigen::Quaterniond::Identity());
  EXPECT_LT(nothing.current_from_reference.angularDistance(Eigen::Quaterniond::Identity()), 1e-9);
  const SmallImage other = RotationEstimator::Shrink(cv::Mat(480, 480, CV_8UC1, cv::Scalar(90)));
  EXPECT_FALSE(estimator.EstimateRotation(blank, other, Eigen::Quaterniond::Identity()).ok);
  const SmallImage tiny = RotationEstimator::Shrink(cv::Mat(5, 3, CV_8UC1, cv::Scalar(90)));
  EXPECT_GE(tiny.values.rows, 8);
}

TEST(RotationEstimator, SmallImageIsUnderAHundredPixelsAndOfZeroMean) {
  const SmallImage small = RotationEstimator::Shrink(PaintReference(Waves(1)));
  EXPECT_LT(small.values.cols, 100);
  EXPECT_LT(small.values.rows, 100);
  EXPECT_NEAR(small.scale, 640.0 / small.values.cols, 1e-9);
  EXPECT_NEAR(cv::mean(small.values)[0], 0, 1e-3);
}

TEST(RotationEstimator, RotationReproducesTheImageMotionOfTheCentrePoints) {
  // A turn about the axis of view is a plane motion, exactly (the axis passes the image's centre here).
  const RotationEstimator estimator(kCamera);
  ImageMotion motion;
  motion.angle_rad = 0.1;
  EXPECT_LT(estimator.RotationFromImageMotion(motion, 6.0).angularDistance(ExpSO3({0, 0, 0.1})), 1e-9);
  // A shift of s pixels: by Eq. (6) a turn t about y moves the points at (x, y) by f t (1 + x^2/f^2, x y/f^2) = f t (a,
  // b), so that by least squares t = s/f a / (a^2 + b^2), to first order.
  motion.angle_rad = 0;
  motion.translation_px = {2, 0};
  const double x = 160 / kCamera.fx, y = 120 / kCamera.fx, a = 1 + x * x, b = x * y;
  const double expected = 2 * 6.0 / kCamera.fx * a / (a * a + b * b);
  EXPECT_NEAR(estimator.RotationFromImageMotion(motion, 6.0).angularDistance(ExpSO3({0, expected, 0})), 0,
              0.01 * expected);
}

TEST(PixelByRotation, EqualsTheNumericDerivative) {
  Random random(2);
  for (int i = 0; i < 50; ++i) {
    const Eigen::Vector3d point(random.Uniform(-2, 2), random.Uniform(-2, 2), random.Uniform(1, 6));
    const Eigen::Matrix<double, 2, 3> jacobian = PixelByRotation(kCamera, point);
    for (int k = 0; k < 3; ++k) {
      const Eigen::Vector3d step = 1e-6 * Eigen::Vector3d::Unit(k);
      const Eigen::Vector2d numeric =
          (kCamera.Project(ExpSO3(step) * point) - kCamera.Project(ExpSO3(-step) * point)) / 2e-6;
      EXPECT_LT((jacobian.col(k) - numeric).norm(), 1e-4 * (1 + numeric.norm()));
    }
  }
}

}  // namespace
}  // namespace portolan
