#include "tracking/rotation_estimator.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>

#include "geometry/rigid3.h"

namespace portolan {
namespace {

constexpr int kMaxSide = 96;        // "less than 100 pixels in both x and y directions" (paper Sec. 3.1)
constexpr double kBlurSigma = 1.5;  // of the small image: widens the basin to a few of its pixels
constexpr int kIterations = 20;
constexpr double kStepTolerance = 1e-3;  // small pixels
constexpr double kMaxRms = 30.0;         // grey levels: beyond it the images show different things
constexpr double kSureRms = 8.0;         // grey levels: below it another start would find no better motion
constexpr double kMinOverlap = 0.4;      // share of the template that must fall into the current image

/// Sums of one ESM step over the pixels where template and warped image both exist.
struct NormalEquations {
  Eigen::Matrix3d hessian = Eigen::Matrix3d::Zero();
  Eigen::Vector3d gradient = Eigen::Vector3d::Zero();
  double squared_error = 0;
  int pixels = 0;
};

/// Plane motion as an affine map of pixels: p -> centre + R (p - centre) + t.
struct PixelMap {
  float c, s, x0, y0;

  PixelMap(const cv::Mat& image, const ImageMotion& motion)
      : c(static_cast<float>(std::cos(motion.angle_rad))), s(static_cast<float>(std::sin(motion.angle_rad))) {
    const float cx = 0.5f * static_cast<float>(image.cols - 1), cy = 0.5f * static_cast<float>(image.rows - 1);
    x0 = cx - c * cx + s * cy + static_cast<float>(motion.translation_px.x());
    y0 = cy - s * cx - c * cy + static_cast<float>(motion.translation_px.y());
  }
};

/// Writes the current image, warped onto row y of the template by bilinear interpolation; NaN outside it.
void WarpRow(const cv::Mat& current, const PixelMap& map, int y, float* warped) {
  const int columns = current.cols, rows = current.rows;
  const auto stride = static_cast<ptrdiff_t>(current.step1());
  const auto* pixels = current.ptr<float>();
  const float right = static_cast<float>(columns - 1), bottom = static_cast<float>(rows - 1);
  float u = map.x0 - map.s * static_cast<float>(y), v = map.y0 + map.c * static_cast<float>(y);
  for (int x = 0; x < columns; ++x, u += map.c, v += map.s) {
    if (!(u >= 0 && v >= 0 && u <= right && v <= bottom)) {
      warped[x] = std::numeric_limits<float>::quiet_NaN();
      continue;
    }
    const int left = std::min(static_cast<int>(u), columns - 2), top = std::min(static_cast<int>(v), rows - 2);
    const float a = u - static_cast<float>(left), b = v - static_cast<float>(top);
    const float* p = pixels + top * stride + left;
    const float above = p[0] + a * (p[1] - p[0]), below = p[stride] + a * (p[stride + 1] - p[stride]);
    warped[x] = above + b * (below - above);
  }
}

/// Sums over pixels of products of (gx, gy, g_angle, 1, error): all that a step needs, whatever the offset of
/// brightness turns out to be.
struct Moments {
  float xx = 0, xy = 0, xa = 0, yy = 0, ya = 0, aa = 0;  // J^T J
  float x = 0, y = 0, a = 0;                             // J^T 1
  float xe = 0, ye = 0, ae = 0, e = 0, ee = 0;           // J^T e, sums of error
  int pixels = 0;
};

/// Row y, 1 to rows - 2. @param warped rows y - 1, y, y + 1 of the warped image.
Moments AccumulateRow(const cv::Mat& reference, const std::array<const float*, 3>& warped, int y) {
  Moments sums;
  const float cx = 0.5f * static_cast<float>(reference.cols - 1),
              dy = static_cast<float>(y) - 0.5f * static_cast<float>(reference.rows - 1);
  const auto *above = reference.ptr<float>(y - 1), *row = reference.ptr<float>(y), *below = reference.ptr<float>(y + 1);
  for (int x = 1; x + 1 < reference.cols; ++x) {
    const float warped_gx = warped[1][x + 1] - warped[1][x - 1], warped_gy = warped[2][x] - warped[0][x];
    const float error = warped[1][x] - row[x];
    if (!(warped_gx + warped_gy + error == warped_gx + warped_gy + error)) continue;  // one of them is NaN: outside
    // (J(e) + J(x_c)) / 2 of paper Eq. (3): mean gradient of template and warped image, times d(pixel) / d(tx, ty,
    // angle).
    const float gx = 0.25f * (row[x + 1] - row[x - 1] + warped_gx), gy = 0.25f * (below[x] - above[x] + warped_gy);
    const float ga = gy * (static_cast<float>(x) - cx) - gx * dy;
    sums.xx += gx * gx, sums.xy += gx * gy, sums.xa += gx * ga, sums.yy += gy * gy, sums.ya += gy * ga,
        sums.aa += ga * ga;
    sums.x += gx, sums.y += gy, sums.a += ga;
    sums.xe += gx * error, sums.ye += gy * error, sums.ae += ga * error, sums.e += error, sums.ee += error * error;
    ++sums.pixels;
  }
  return sums;
}

/// Adds up the rows in double. The brightness of the overlap may differ (auto exposure): its mean difference is no
/// motion and is taken off.
NormalEquations Accumulate(const cv::Mat& reference, const cv::Mat& current, const ImageMotion& motion) {
  const PixelMap map(current, motion);
  const auto columns = static_cast<size_t>(reference.cols);
  std::vector<float> rows(3 * columns);
  const auto row = [&](int y) { return rows.data() + static_cast<size_t>(y % 3) * columns; };
  WarpRow(current, map, 0, row(0));
  WarpRow(current, map, 1, row(1));
  NormalEquations sums;
  Eigen::Vector3d jacobian_sum = Eigen::Vector3d::Zero();
  double error_sum = 0;
  for (int y = 1; y + 1 < reference.rows; ++y) {
    WarpRow(current, map, y + 1, row(y + 1));
    const Moments m = AccumulateRow(reference, {row(y - 1), row(y), row(y + 1)}, y);
    Eigen::Matrix3f hessian;
    hessian << m.xx, m.xy, m.xa, m.xy, m.yy, m.ya, m.xa, m.ya, m.aa;
    sums.hessian += hessian.cast<double>();
    sums.gradient += Eigen::Vector3f(m.xe, m.ye, m.ae).cast<double>();
    jacobian_sum += Eigen::Vector3f(m.x, m.y, m.a).cast<double>();
    error_sum += m.e;
    sums.squared_error += m.ee;
    sums.pixels += m.pixels;
  }
  if (sums.pixels == 0) return sums;
  const double offset = error_sum / sums.pixels;
  sums.gradient -= offset * jacobian_sum;
  sums.squared_error = std::max(0.0, sums.squared_error - offset * error_sum);
  return sums;
}

/// Four points about the image centre, a quarter of the image away from it (paper Sec. 3.1), in full pixels.
std::array<Eigen::Vector2d, 4> CentrePoints(const PinholeCamera& camera) {
  const double x = 0.5 * (camera.width - 1), y = 0.5 * (camera.height - 1);
  const double dx = 0.25 * camera.width, dy = 0.25 * camera.height;
  return {Eigen::Vector2d(x - dx, y - dy), Eigen::Vector2d(x + dx, y - dy), Eigen::Vector2d(x - dx, y + dy),
          Eigen::Vector2d(x + dx, y + dy)};
}

}  // namespace

Eigen::Matrix<double, 2, 3> PixelByRotation(const PinholeCamera& camera, const Eigen::Vector3d& point_in_camera) {
  const double x = point_in_camera.x(), y = point_in_camera.y(), z = point_in_camera.z();
  Eigen::Matrix<double, 2, 3> jacobian;  // paper Eq. (6)
  jacobian << -x * y / (z * z) * camera.fx, camera.fx + x * x / (z * z) * camera.fx, -y / z * camera.fx,
      -camera.fy - y * y / (z * z) * camera.fy, x * y / (z * z) * camera.fy, x / z * camera.fy;
  return jacobian;
}

SmallImage RotationEstimator::Shrink(const cv::Mat& grey) {
  SmallImage small;
  small.scale = std::max(1.0, static_cast<double>(std::max(grey.cols, grey.rows)) / kMaxSide);
  const cv::Size size(std::max(8, static_cast<int>(grey.cols / small.scale)),
                      std::max(8, static_cast<int>(grey.rows / small.scale)));
  // By halves first, which is several times faster; an odd last row or column is left out.
  cv::Mat reduced = grey;
  while (reduced.cols >= 2 * size.width && reduced.rows >= 2 * size.height) {
    const cv::Size half(reduced.cols / 2, reduced.rows / 2);
    cv::Mat halved;
    cv::resize(reduced(cv::Rect(0, 0, 2 * half.width, 2 * half.height)), halved, half, 0, 0, cv::INTER_AREA);
    reduced = halved;
  }
  cv::resize(reduced, reduced, size, 0, 0, cv::INTER_AREA);
  reduced.convertTo(small.values, CV_32F);
  cv::GaussianBlur(small.values, small.values, cv::Size(0, 0), kBlurSigma);
  small.values -= cv::mean(small.values)[0];
  return small;
}

ImageMotion RotationEstimator::EstimateImageMotion(const SmallImage& reference, const SmallImage& current,
                                                   const ImageMotion& initial) const {
  ImageMotion motion = initial;
  motion.converged = false;
  const double min_pixels = kMinOverlap * static_cast<double>(reference.values.total());
  for (int i = 0; i < kIterations; ++i) {
    const NormalEquations sums = Accumulate(reference.values, current.values, motion);
    if (sums.pixels < min_pixels) return motion;
    motion.rms = std::sqrt(sums.squared_error / sums.pixels);
    const Eigen::Matrix3d damped = sums.hessian + 1e-6 * sums.hessian.trace() * Eigen::Matrix3d::Identity();
    const Eigen::Vector3d step = -damped.ldlt().solve(sums.gradient);  // paper Eq. (3)
    if (!step.allFinite()) return motion;
    // x <- x o step: the step moves the template's pixels before the motion so far does.
    const Eigen::Rotation2Dd rotation(motion.angle_rad);
    motion.translation_px += rotation * step.head<2>();
    motion.angle_rad += step.z();
    const double pixels = step.head<2>().norm() + std::abs(step.z()) * 0.5 * reference.values.cols;
    if (pixels < kStepTolerance) {
      motion.converged = motion.rms < kMaxRms;
      return motion;
    }
  }
  motion.converged = motion.rms < kMaxRms;
  return motion;
}

Eigen::Quaterniond RotationEstimator::RotationFromImageMotion(const ImageMotion& motion, double scale) const {
  const Eigen::Vector2d centre(0.5 * (camera_.width - 1), 0.5 * (camera_.height - 1));
  const Eigen::Rotation2Dd in_plane(motion.angle_rad);
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  for (int i = 0; i < 10; ++i) {
    Eigen::Matrix3d hessian = Eigen::Matrix3d::Zero();
    Eigen::Vector3d gradient = Eigen::Vector3d::Zero();
    for (const Eigen::Vector2d& pixel : CentrePoints(camera_)) {
      const Eigen::Vector2d moved = centre + in_plane * (pixel - centre) + scale * motion.translation_px;
      const Eigen::Vector3d point = rotation * camera_.Unproject(pixel);
      if (point.z() <= 0) return Eigen::Quaterniond::Identity();
      const Eigen::Vector2d error = moved - camera_.Project(point);  // paper Eq. (4)
      const Eigen::Matrix<double, 2, 3> jacobian = PixelByRotation(camera_, point);
      hessian += jacobian.transpose() * jacobian;
      gradient += jacobian.transpose() * error;
    }
    const Eigen::Vector3d step = hessian.ldlt().solve(gradient);  // paper Eq. (5)
    rotation = (ExpSO3(step) * rotation).normalized();
    if (step.norm() < 1e-9) break;
  }
  return rotation;
}

ImageMotion RotationEstimator::ImageMotionFromRotation(const Eigen::Quaterniond& current_from_reference,
                                                       double scale) const {
  // The rigid plane motion of the four centre points that fits their motion under the rotation best (2D Procrustes).
  const Eigen::Vector2d centre(0.5 * (camera_.width - 1), 0.5 * (camera_.height - 1));
  ImageMotion motion;
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  double dot = 0, cross = 0;
  for (const Eigen::Vector2d& pixel : CentrePoints(camera_)) {
    const Eigen::Vector3d ray = current_from_reference * camera_.Unproject(pixel);
    if (ray.z() <= 0) return motion;
    const Eigen::Vector2d arm = pixel - centre, moved = camera_.Project(ray) - centre;
    mean += 0.25 * moved;
    dot += arm.dot(moved);
    cross += arm.x() * moved.y() - arm.y() * moved.x();
  }
  motion.translation_px = mean / scale;
  motion.angle_rad = std::atan2(cross, dot);
  return motion;
}

RotationEstimator::Estimate RotationEstimator::EstimateRotation(const SmallImage& reference, const SmallImage& current,
                                                                const Eigen::Quaterniond& predicted) const {
  if (reference.values.size() != current.values.size()) return {};
  ImageMotion motion = EstimateImageMotion(reference, current);
  const bool is_sure = motion.converged && motion.rms < kSureRms;
  if (!is_sure && predicted.angularDistance(Eigen::Quaterniond::Identity()) > 0.01) {
    const ImageMotion other =
        EstimateImageMotion(reference, current, ImageMotionFromRotation(predicted, current.scale));
    if (other.converged && (!motion.converged || other.rms < motion.rms)) motion = other;
  }
  if (!motion.converged) return {};
  return {RotationFromImageMotion(motion, current.scale), true};
}

}  // namespace portolan
