#include "geometry/camera_model.h"

#include <Eigen/LU>
#include <cmath>
#include <limits>
#include <sstream>
#include <utility>

namespace portolan {
namespace {

constexpr double kMaxFisheyeAngle =
    80.0 * M_PI / 180.0;                    // beyond it an ideal pixel lies over 5.7 focal lengths from the centre
constexpr int kMaxNewtonSteps = 30;         // 3 to 6 are usual; the limit only ends hopeless cases
constexpr double kNewtonTolerance = 1e-10;  // on the plane z = 1: under 1e-6 pixels for any real focal length

const Eigen::Vector2d kNoPixel = Eigen::Vector2d::Constant(std::numeric_limits<double>::quiet_NaN());

/// Radial-tangential distortion of a point on the plane z = 1, and its Jacobian where wanted.
Eigen::Vector2d DistortRadialTangential(const std::array<double, 5>& k, const Eigen::Vector2d& xy,
                                        Eigen::Matrix2d* jacobian) {
  const double x = xy.x(), y = xy.y(), r2 = x * x + y * y;
  const double k1 = k[0], k2 = k[1], p1 = k[2], p2 = k[3], k3 = k[4];
  const double radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3));
  if (jacobian != nullptr) {
    const double slope = 2 * (k1 + r2 * (2 * k2 + r2 * 3 * k3));  // d radial / dx = slope * x
    const double cross = slope * x * y + 2 * p1 * x + 2 * p2 * y;
    *jacobian << radial + slope * x * x + 2 * p1 * y + 6 * p2 * x, cross, cross,
        radial + slope * y * y + 6 * p1 * y + 2 * p2 * x;
  }
  return {x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x), y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y};
}

/// Inverts the radial-tangential distortion by Newton's method. NaN where the lens model has no inverse: outside the
/// disc in which it is one to one.
Eigen::Vector2d UndistortRadialTangential(const std::array<double, 5>& k, const Eigen::Vector2d& distorted_xy) {
  Eigen::Vector2d xy = distorted_xy;
  for (int step = 0; step < kMaxNewtonSteps; ++step) {
    Eigen::Matrix2d jacobian;
    const Eigen::Vector2d error = DistortRadialTangential(k, xy, &jacobian) - distorted_xy;
    if (!(jacobian.determinant() > 0)) return kNoPixel;
    const Eigen::Vector2d correction = jacobian.inverse() * error;
    xy -= correction;
    if (correction.squaredNorm() < kNewtonTolerance * kNewtonTolerance) return xy;
  }
  return kNoPixel;
}

/// theta_d = theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8), and its slope.
std::pair<double, double> FisheyePolynomial(const std::array<double, 5>& k, double theta) {
  const double t2 = theta * theta;
  const double value = theta * (1 + t2 * (k[0] + t2 * (k[1] + t2 * (k[2] + t2 * k[3]))));
  const double slope = 1 + t2 * (3 * k[0] + t2 * (5 * k[1] + t2 * (7 * k[2] + t2 * 9 * k[3])));
  return {value, slope};
}

/// Inverts the fisheye polynomial by Newton's method. NaN beyond kMaxFisheyeAngle or where it has no inverse.
Eigen::Vector2d UndistortFisheye(const std::array<double, 5>& k, const Eigen::Vector2d& distorted_xy) {
  const double theta_d = distorted_xy.norm();
  if (theta_d == 0) return distorted_xy;
  double theta = theta_d;
  for (int step = 0; step < kMaxNewtonSteps; ++step) {
    const auto [value, slope] = FisheyePolynomial(k, theta);
    if (!(slope > 0)) return kNoPixel;
    const double correction = (value - theta_d) / slope;
    theta -= correction;
    if (std::abs(correction) >= kNewtonTolerance) continue;
    if (theta < 0 || theta > kMaxFisheyeAngle) return kNoPixel;
    return std::tan(theta) / theta_d * distorted_xy;
  }
  return kNoPixel;
}

Error FieldError(const std::string& field, double value, const std::string& expected) {
  std::ostringstream text;
  text << "camera: " << field << " is " << value << ", expected " << expected;
  return Error{text.str()};
}

}  // namespace

bool IsSound(const RadialResidual& residual) {
  return std::abs(residual.k1) <= kMaxRadialResidual && std::abs(residual.k2) <= kMaxRadialResidual;  // false for NaN
}

Status CameraModel::Check() const {
  const std::pair<const char*, double> focal_lengths[] = {{"fx", pinhole.fx}, {"fy", pinhole.fy}};
  for (const auto& [name, value] : focal_lengths) {
    if (!(std::isfinite(value) && value > 0)) return FieldError(name, value, "a finite positive number of pixels");
  }
  const std::pair<const char*, int> sizes[] = {{"width", pinhole.width}, {"height", pinhole.height}};
  for (const auto& [name, value] : sizes) {
    if (value <= 0) return FieldError(name, value, "a positive number of pixels");
  }
  if (!(pinhole.cx >= 0 && pinhole.cx <= pinhole.width)) {
    return FieldError("cx", pinhole.cx, "a number inside the image, 0 to " + std::to_string(pinhole.width));
  }
  if (!(pinhole.cy >= 0 && pinhole.cy <= pinhole.height)) {
    return FieldError("cy", pinhole.cy, "a number inside the image, 0 to " + std::to_string(pinhole.height));
  }
  for (size_t i = 0; i < coefficients.size(); ++i) {
    if (!std::isfinite(coefficients[i])) {
      return FieldError("distortion coefficient " + std::to_string(i), coefficients[i], "a finite number");
    }
  }
  if (!(std::isfinite(fps) && fps >= 0)) return FieldError("fps", fps, "a finite number of at least 0");
  return Ok{};
}

std::vector<cv::Point2f> CameraModel::Undistort(const std::vector<cv::Point2f>& pixels_px) const {
  if (IsIdeal()) return pixels_px;
  const std::array<double, 5> left = {residual.k1, residual.k2, 0, 0, 0};
  std::vector<cv::Point2f> ideal_px;
  ideal_px.reserve(pixels_px.size());
  for (const cv::Point2f& pixel : pixels_px) {
    const Eigen::Vector2d distorted_xy = pinhole.Normalize({pixel.x, pixel.y});
    Eigen::Vector2d xy = distorted_xy;
    if (distortion == Distortion::kKannalaBrandt4) xy = UndistortFisheye(coefficients, xy);
    if (distortion == Distortion::kRadialTangential) xy = UndistortRadialTangential(coefficients, xy);
    if (!residual.IsNone() && xy.allFinite()) xy = UndistortRadialTangential(left, xy);
    ideal_px.emplace_back(static_cast<float>(pinhole.fx * xy.x() + pinhole.cx),
                          static_cast<float>(pinhole.fy * xy.y() + pinhole.cy));
  }
  return ideal_px;
}

Eigen::Vector2d CameraModel::Distort(const Eigen::Vector3d& point_in_camera) const {
  const Eigen::Vector2d xy = residual.Distort(point_in_camera.hnormalized());
  Eigen::Vector2d distorted_xy = xy;
  if (distortion == Distortion::kRadialTangential) {
    distorted_xy = DistortRadialTangential(coefficients, xy, nullptr);
  } else if (distortion == Distortion::kKannalaBrandt4) {
    const double radius = xy.norm();
    if (radius > 0) distorted_xy = FisheyePolynomial(coefficients, std::atan(radius)).first / radius * xy;
  }
  return {pinhole.fx * distorted_xy.x() + pinhole.cx, pinhole.fy * distorted_xy.y() + pinhole.cy};
}

}  // namespace portolan
