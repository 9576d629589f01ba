#include "testing/lens_warp.h"

#include <cmath>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "base/check.h"

namespace portolan {
namespace {

constexpr int kBorder = 2;               // pixels that cubic interpolation takes from around a place
constexpr double kMaxShiftShare = 0.25;  // of the image's width

/// The ideal pixel of every pixel, row by row; NaN where there is none.
std::vector<cv::Point2f> IdealPixels(const PinholeCamera& camera, const RadialResidual& lens) {
  std::vector<cv::Point2f> pixels;
  for (int y = 0; y < camera.height; ++y) {
    for (int x = 0; x < camera.width; ++x) pixels.emplace_back(static_cast<float>(x), static_cast<float>(y));
  }
  CameraModel model;
  model.pinhole = camera;
  model.residual = lens;
  return model.Undistort(pixels);
}

}  // namespace

bool LensWarp::IsPossible(const PinholeCamera& camera, const RadialResidual& lens) {
  const std::vector<cv::Point2f> ideal_px = IdealPixels(camera, lens);
  for (size_t i = 0; i < ideal_px.size(); ++i) {
    const auto width = static_cast<size_t>(camera.width);
    const double shift_px =
        std::hypot(ideal_px[i].x - static_cast<double>(i % width), ideal_px[i].y - static_cast<double>(i / width));
    if (!(shift_px <= kMaxShiftShare * camera.width)) return false;  // or NaN
  }
  return true;
}

LensWarp::LensWarp(const PinholeCamera& camera, const RadialResidual& lens) : ideal_camera_(camera) {
  PORTOLAN_CHECK(IsPossible(camera, lens)) << " no picture through k1 " << lens.k1 << " k2 " << lens.k2;
  std::vector<cv::Point2f> ideal_px = IdealPixels(camera, lens);
  // The lens is round about the principal point: the border is as wide as the farthest pixel asks, on all sides.
  float outside = 0;
  for (const cv::Point2f& p : ideal_px) {
    outside = std::max(
        {outside, -p.x, -p.y, p.x - static_cast<float>(camera.width - 1), p.y - static_cast<float>(camera.height - 1)});
  }
  const int border = static_cast<int>(std::ceil(outside)) + kBorder;
  ideal_camera_.width += 2 * border;
  ideal_camera_.height += 2 * border;
  ideal_camera_.cx += border;
  ideal_camera_.cy += border;
  const auto shift = static_cast<float>(border);
  for (cv::Point2f& p : ideal_px) p += cv::Point2f(shift, shift);
  map_px_ = cv::Mat(ideal_px, true).reshape(2, camera.height);
}

cv::Mat LensWarp::Apply(const cv::Mat& light) const {
  PORTOLAN_CHECK(light.cols == ideal_camera_.width && light.rows == ideal_camera_.height)
      << light.cols << "x" << light.rows;
  cv::Mat warped;
  cv::remap(light, warped, map_px_, cv::noArray(), cv::INTER_CUBIC);
  return warped;
}

}  // namespace portolan
