#include "tracking/rotation_estimator.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "geometry/rigid3.h"

namespace portolan {
namespace {

constexpr int kMaxSide = 96;             // "less than 100 pixels in both x and y directions" (paper Sec. 3.1)
constexpr double kBlurSigma = 1.5;       // of the small image: widens the basin to a few of its pixels
constexpr int kIterations = 20;
constexpr double kStepTolerance = 1e-3;  // small pixels
constexpr double kMaxRms = 30.0;         // grey levels: beyond it the images show different things
constexpr double kMinOverlap = 0.4;      // share of the template that must fall into the current image

/// The image's gradient by central differences at pixel (x, y).
Eigen::Vector2f Gradient(const cv::Mat& image, int x, int y) {
  return {0.5f * (image.at<float>(y, x + 1) - image.at<float>(y, x - 1)),
          0.5f * (image.at<float>(y + 1, x) - image.at<float>(y - 1, x))};
}

/// The current image warped by the motion onto the template's pixels; `inside` marks those that fall into it.
void Warp(const cv::Mat& current, const ImageMotion& motion, cv::Mat* warped, cv::Mat* inside) {
  const double cx = 0.5 * (current.cols - 1), cy = 0.5 * (current.rows - 1);
  const double c = std::cos(motion.angle_rad), s = std::sin(motion.angle_rad);
  // p -> centre + R (p - centre) + t, as the inverse map that warpAffine wants.
  const cv::Matx23d map(c, -s, cx - c * cx + s * cy + motion.translation_px.x(),  //
                        s, c, cy - s * cx - c * cy + motion.translation_px.y());
  cv::warpAffine(current, *warped, map, current.size(), cv::INTER_LINEAR | cv::WARP_INVERSE_MAP, cv::BORDER_CONSTANT,
                 std::nanf(""));
  *inside = (*warped == *warped);
}

/// Sums of one ESM step over the pixels where template and warped image both exist.
struct NormalEquations {
  Eigen::Matrix3d hessian = Eigen::Matrix3d::Zero();
  Eigen::Vector3d gradient = Eigen::Vector3d::Zero();
  double squared_error = 0;
  int pixels = 0;
};

NormalEquations Accumulate(const cv::Mat& reference, const cv::Mat& warped, const cv::Mat& inside) {
  NormalEquations sums;
  const double cx = 0.5 * (reference.cols - 1), cy = 0.5 * (reference.rows - 1);
  // Brightness of the overlap may differ (auto exposure): its mean difference is no motion.
  const double offset = cv::mean(warped - reference, inside)[0];
  for (int y = 1; y + 1 < reference.rows; ++y) {
    for (int x = 1; x + 1 < reference.cols; ++x) {
      if (!inside.at<uchar>(y, x)) continue;
      const Eigen::Vector2f warped_gradient = Gradient(warped, x, y);
      if (!warped_gradient.allFinite()) continue;
      // (J(e) + J(x_c)) / 2 of paper Eq. (3): mean gradient of template and warped image, times d(pixel) / d(tx, ty, angle).
      const Eigen::Vector2d g = 0.5 * (Gradient(reference, x, y) + warped_gradient).cast<double>();
      const Eigen::Vector3d jacobian(g.x(), g.y(), -g.x() * (y - cy) + g.y() * (x - cx));
      const double error = warped.at<float>(y, x) - reference.at<float>(y, x) - offset;
      sums.hessian.selfadjointView<Eigen::Lower>().rankUpdate(jacobian);
      sums.gradient += jacobian * error;
      sums.squared_error += error * error;
      ++sums.pixels;
    }
  }
  sums.hessian = sums.hessian.selfadjointView<Eigen::Lower>();
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
  const cv::Size size(std::max(8, static_cast<int>(grey.cols / small.scale)), std::max(8, static_cast<int>(grey.rows / small.scale)));
  cv::Mat reduced;
  cv::resize(grey, reduced, size, 0, 0, cv::INTER_AREA);
  reduced.convertTo(small.values, CV_32F);
  cv::GaussianBlur(small.values, small.values, cv::Size(0, 0), kBlurSigma);
  small.values -= cv::mean(small.values)[0];
  return small;
}

ImageMotion RotationEstimator::EstimateImageMotion(const SmallImage& reference, const SmallImage& current,
                                                   const ImageMotion& initial) const {
  ImageMotion motion = initial;
  motion.converged = false;
  cv::Mat warped, inside;
  const double min_pixels = kMinOverlap * static_cast<double>(reference.values.total());
  for (int i = 0; i < kIterations; ++i) {
    Warp(current.values, motion, &warped, &inside);
    const NormalEquations sums = Accumulate(reference.values, warped, inside);
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
      const Eigen::Vector2d error = moved - camera_.Project(point);       // paper Eq. (4)
      const Eigen::Matrix<double, 2, 3> jacobian = PixelByRotation(camera_, point);
      hessian += jacobian.transpose() * jacobian;
      gradient += jacobian.transpose() * error;
    }
    const Eigen::Vector3d step = hessian.ldlt().solve(gradient);          // paper Eq. (5)
    rotation = (ExpSO3(step) * rotation).normalized();
    if (step.norm() < 1e-9) break;
  }
  return rotation;
}

ImageMotion RotationEstimator::ImageMotionFromRotation(const Eigen::Quaterniond& current_from_reference, double scale) const {
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
  if (predicted.angularDistance(Eigen::Quaterniond::Identity()) > 0.01) {
    const ImageMotion other = EstimateImageMotion(reference, current, ImageMotionFromRotation(predicted, current.scale));
    if (other.converged && (!motion.converged || other.rms < motion.rms)) motion = other;
  }
  if (!motion.converged) return {};
  return {RotationFromImageMotion(motion, current.scale), true};
}

}  // namespace portolan
