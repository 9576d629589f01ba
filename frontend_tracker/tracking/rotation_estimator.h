#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <opencv2/core.hpp>
#include <vector>

#include "geometry/camera_model.h"

namespace portolan {

/// An image made ready for rotation estimation: small, blurred, of zero mean (paper Sec. 3.1).
struct SmallImage {
  cv::Mat values;      ///< CV_32FC1, under 100 pixels in both directions
  double scale = 1.0;  ///< pixels of the full image per pixel of this one
};

/// A motion in the image plane: rotation about the centre of the small image and translation, in its pixels.
struct ImageMotion {
  Eigen::Vector2d translation_px = Eigen::Vector2d::Zero();
  double angle_rad = 0;
  double rms = 0;  ///< remaining photometric error, grey levels
  bool converged = false;
};

/// Estimates the camera's rotation between two frames from small images: a template is tracked in the plane by
/// efficient second-order minimisation (ESM; Benhimane and Malis, IROS 2004; paper Eq. 3), then the 3D rotation that
/// moves four points about the centre in the same way is found by Gauss-Newton (paper Eq. 4-6). Stateless, thread-safe.
class RotationEstimator {
 public:
  explicit RotationEstimator(const PinholeCamera& camera) : camera_(camera) {}

  static SmallImage Shrink(const cv::Mat& grey);

  /// The plane motion that carries the reference image onto the current one: current(motion(p)) = reference(p). Starts
  /// from `initial`; `converged` is false when the images do not overlap or the error does not settle.
  ImageMotion EstimateImageMotion(const SmallImage& reference, const SmallImage& current,
                                  const ImageMotion& initial = {}) const;

  /// current_from_reference rotation which makes far points move as `motion` says (paper Eq. 4-6).
  Eigen::Quaterniond RotationFromImageMotion(const ImageMotion& motion, double scale) const;

  /// Both steps. Starts from no motion (paper); where that does not end in a sure match also from what the `predicted`
  /// rotation would do to the image, and takes the better of the two.
  struct Estimate {
    Eigen::Quaterniond current_from_reference = Eigen::Quaterniond::Identity();
    bool ok = false;
  };
  Estimate EstimateRotation(const SmallImage& reference, const SmallImage& current,
                            const Eigen::Quaterniond& predicted) const;

 private:
  ImageMotion ImageMotionFromRotation(const Eigen::Quaterniond& current_from_reference, double scale) const;

  PinholeCamera camera_;
};

/// Jacobian of a pixel with respect to a rotation vector applied to its 3D point (paper Eq. 6). 2x3.
Eigen::Matrix<double, 2, 3> PixelByRotation(const PinholeCamera& camera, const Eigen::Vector3d& point_in_camera);

}  // namespace portolan
