#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <vector>

#include "base/result.h"

namespace portolan {

/// An ideal pinhole camera, without distortion: pixel = (fx x/z + cx, fy y/z + cy). Pixel (0,0) is the centre of the
/// top-left pixel. All geometry after feature extraction uses it: features are undistorted once, when they are made.
struct PinholeCamera {
  double fx = 0, fy = 0, cx = 0, cy = 0;  ///< pixels
  int width = 0, height = 0;              ///< of the image, pixels

  /// @param point_in_camera with z > 0. @return pixel.
  Eigen::Vector2d Project(const Eigen::Vector3d& point_in_camera) const {
    const double inverse_z = 1.0 / point_in_camera.z();
    return {fx * point_in_camera.x() * inverse_z + cx, fy * point_in_camera.y() * inverse_z + cy};
  }
  /// @return (x, y) on the plane z = 1.
  Eigen::Vector2d Normalize(const Eigen::Vector2d& pixel_px) const {
    return {(pixel_px.x() - cx) / fx, (pixel_px.y() - cy) / fy};
  }
  /// @return the ray (x, y, 1) through the pixel.
  Eigen::Vector3d Unproject(const Eigen::Vector2d& pixel_px) const { return Normalize(pixel_px).homogeneous(); }
  bool Contains(const Eigen::Vector2d& pixel_px) const {
    return pixel_px.x() >= 0 && pixel_px.y() >= 0 && pixel_px.x() <= width - 1 && pixel_px.y() <= height - 1;
  }
  Eigen::Matrix3d K() const {
    Eigen::Matrix3d k;
    k << fx, 0, cx, 0, fy, cy, 0, 0, 1;
    return k;
  }
  friend bool operator==(const PinholeCamera& a, const PinholeCamera& b) {
    return a.fx == b.fx && a.fy == b.fy && a.cx == b.cx && a.cy == b.cy && a.width == b.width && a.height == b.height;
  }
  friend bool operator!=(const PinholeCamera& a, const PinholeCamera& b) { return !(a == b); }
};

/// How a lens departs from the pinhole.
enum class Distortion {
  kNone,
  kRadialTangential,  ///< OpenCV's k1 k2 p1 p2 k3
  kKannalaBrandt4,    ///< fisheye: theta polynomial k1 k2 k3 k4 (OpenCV's fisheye, "KB4", "equidistant")
};

/// Radial distortion that a calibration left, found while mapping: a point (x, y) on the plane z = 1 appears, once the
/// calibration's own distortion is taken out, at (1 + k1 r^2 + k2 r^4) (x, y), with r^2 = x^2 + y^2.
struct RadialResidual {
  double k1 = 0, k2 = 0;

  bool IsNone() const { return k1 == 0 && k2 == 0; }
  Eigen::Vector2d Distort(const Eigen::Vector2d& xy) const {
    const double r2 = xy.squaredNorm();
    return (1 + r2 * (k1 + r2 * k2)) * xy;
  }
  friend bool operator==(const RadialResidual& a, const RadialResidual& b) { return a.k1 == b.k1 && a.k2 == b.k2; }
};

/// Of either coefficient; whole lenses have less.
inline constexpr double kMaxRadialResidual = 1.0;
/// Both coefficients finite and within kMaxRadialResidual.
bool IsSound(const RadialResidual& residual);

/// Which camera a residual is of.
struct CameraResidual {
  PinholeCamera camera;
  RadialResidual residual;

  friend bool operator==(const CameraResidual& a, const CameraResidual& b) {
    return a.camera == b.camera && a.residual == b.residual;
  }
};

/// A calibrated camera: a pinhole and its lens distortion.
/// Source: OpenCV calib3d documentation for radial-tangential; Kannala and Brandt, PAMI 2006 for KB4.
struct CameraModel {
  PinholeCamera pinhole;  ///< intrinsics and image size; the ideal camera that features are undistorted to
  Distortion distortion = Distortion::kNone;
  std::array<double, 5> coefficients{};  ///< k1 k2 p1 p2 k3, or k1 k2 k3 k4 and 0
  RadialResidual residual;               ///< on top of them
  double fps = 0;                        ///< nominal frame rate, 0 if unknown

  /// Finite values, positive focal lengths and size, principal point inside the image; the message names the field.
  Status Check() const;

  /// Whether pixels of the image are those of the ideal camera.
  bool IsIdeal() const { return distortion == Distortion::kNone && residual.IsNone(); }

  /// Distorted (as in the image) to ideal pixels. Fisheye rays beyond 80 degrees from the axis have no ideal pixel:
  /// those come back as NaN and their features are dropped. @param pixels_px N. @return N.
  std::vector<cv::Point2f> Undistort(const std::vector<cv::Point2f>& pixels_px) const;

  /// Point in the camera's frame (z > 0) to the distorted pixel of the image.
  Eigen::Vector2d Distort(const Eigen::Vector3d& point_in_camera) const;
};

}  // namespace portolan
