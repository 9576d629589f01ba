#include "features/subpixel.h"

#include <gtest/gtest.h>

#include <cmath>

#include "base/check.h"
#include "base/statistics.h"
#include "features/corner_detection.h"
#include "features/test_images.h"

namespace portolan {
namespace {

/// A bright quadrangle moved by shift_px, each pixel the mean over its area. Its leftmost corner is at (22, 30) plus
/// the shift.
cv::Mat ShiftedQuadrangle(const Eigen::Vector2d& shift_px) {
  constexpr int kSubsamples = 16;
  cv::Mat fine(64 * kSubsamples, 64 * kSubsamples, CV_8UC1, cv::Scalar(40));
  std::vector<cv::Point> corners;
  for (const Eigen::Vector2d& corner : {Eigen::Vector2d(22, 30), {42, 18}, {48, 38}, {37, 46}}) {
    const Eigen::Vector2d moved = (corner + shift_px) * kSubsamples;
    corners.emplace_back(static_cast<int>(std::lround(moved.x())), static_cast<int>(std::lround(moved.y())));
  }
  cv::fillConvexPoly(fine, corners, cv::Scalar(200));
  cv::Mat image;
  cv::resize(fine, image, cv::Size(64, 64), 0, 0, cv::INTER_AREA);
  cv::GaussianBlur(image, image, cv::Size(5, 5), 0.8);  // a camera's own blur
  return image;
}

/// The location of the quadrangle's leftmost corner, refined or not.
Eigen::Vector2d LocateLeftmost(const cv::Mat& image, bool subpixel) {
  CornerDetector detector(20, 7, 35, 4);
  const Corner* leftmost = nullptr;
  for (const Corner& corner : detector.Detect(image)) {
    if (leftmost == nullptr || corner.x < leftmost->x) leftmost = &corner;
  }
  PORTOLAN_CHECK(leftmost != nullptr);
  const Eigen::Vector2d pixel(leftmost->x, leftmost->y);
  if (!subpixel) return pixel;
  return pixel + SubpixelOffset(image, leftmost->x, leftmost->y).cast<double>();
}

/// Median distance, in pixels, of the corner's locations under shifts all over a pixel from where the shifts take it.
/// Where in the shape the corner lies is up to the detector: the median offset is taken out.
double MedianShiftError(bool subpixel) {
  std::vector<double> offsets_x, offsets_y, errors;
  for (double dx = 0; dx < 1; dx += 0.125) {
    for (double dy = 0; dy < 1; dy += 0.125) {
      const Eigen::Vector2d offset = LocateLeftmost(ShiftedQuadrangle({dx, dy}), subpixel) - Eigen::Vector2d(dx, dy);
      offsets_x.push_back(offset.x());
      offsets_y.push_back(offset.y());
    }
  }
  const double middle_x = Quantile(offsets_x, 0.5), middle_y = Quantile(offsets_y, 0.5);
  for (size_t i = 0; i < offsets_x.size(); ++i)
    errors.push_back(std::hypot(offsets_x[i] - middle_x, offsets_y[i] - middle_y));
  return Quantile(errors, 0.5);
}

TEST(SubpixelOffset, IsZeroWithoutContrast) {
  EXPECT_EQ(SubpixelOffset(cv::Mat(32, 32, CV_8UC1, cv::Scalar(77)), 16, 16), Eigen::Vector2f::Zero());
}

TEST(SubpixelOffset, StaysWithinHalfAPixel) {
  const cv::Mat image = TexturedImage(160, 120, 2);
  for (int y = 4; y < 116; ++y) {
    for (int x = 4; x < 156; ++x) EXPECT_LE(SubpixelOffset(image, x, y).cwiseAbs().maxCoeff(), 0.5f);
  }
}

TEST(SubpixelOffset, TurnsWithTheImage) {
  const cv::Mat image = TexturedImage(41, 41, 3);
  cv::Mat turned;
  cv::rotate(image, turned, cv::ROTATE_90_CLOCKWISE);
  const Eigen::Vector2f offset = SubpixelOffset(image, 20, 20);
  EXPECT_TRUE(SubpixelOffset(turned, 20, 20).isApprox(Eigen::Vector2f(-offset.y(), offset.x()), 1e-4f));
}

TEST(SubpixelOffset, FollowsShiftsOfAFractionOfAPixel) {
  const double error_whole = MedianShiftError(false), error_subpixel = MedianShiftError(true);
  EXPECT_GT(error_whole, 0.3);  // 0.38 is the median distance to the nearest whole pixel
  EXPECT_LT(error_subpixel, 0.4 * error_whole);
}

}  // namespace
}  // namespace portolan
