#pragma once

#include <ceres/sized_cost_function.h>

#include <Eigen/Core>

#include "geometry/camera_model.h"
#include "geometry/rigid3.h"

namespace portolan {

/// A pose during optimisation: a small update (3 of translation, then a rotation vector) on a reference,
///   camera_from_map = [Exp(r) R_ref, t_ref + t].
/// The update is the parameter block of the solver. All measurements of a pose share this object, so that its rotation
/// matrix is computed once per evaluation and not once per measurement; Prepare() must be called when the update has
/// changed.
class PoseUpdate {
 public:
  explicit PoseUpdate(const Rigid3d& reference_camera_from_map);

  double* parameters() { return update_.data(); }
  const double* parameters() const { return update_.data(); }
  /// Brings rotation(), translation() and left_jacobian() up to date with the parameters.
  void Prepare();
  /// The pose at the present parameters.
  Rigid3d CameraFromMap() const;

  const Eigen::Matrix3d& rotation() const { return rotation_; }
  const Eigen::Vector3d& translation() const { return translation_; }
  /// J of Exp(r + d) = Exp(J d) Exp(r) to first order.
  const Eigen::Matrix3d& left_jacobian() const { return left_jacobian_; }

 private:
  Rigid3d reference_;
  Vector6d update_ = Vector6d::Zero();
  Eigen::Matrix3d rotation_, left_jacobian_;
  Eigen::Vector3d translation_;
};

/// Where and how exactly a landmark was seen.
struct PixelMeasurement {
  Eigen::Vector2d pixel_px;
  double inverse_sigma;  ///< 1 / px
};

/// Residual of a point that is not in front of the camera, in units of sigma and in both components: as bad as a gross
/// outlier, and constant, so that no step is refused because of it and none is taken towards hiding points behind
/// cameras.
inline constexpr double kBehindCameraResidual = 50.0;

/// Reprojection error in units of sigma, (Project(camera, camera_from_map * X) - pixel) / sigma, with analytic
/// Jacobians. Parameters: pose update (6), point in map (3). The pose's own parameters are read from the prepared
/// PoseUpdate.
class ReprojectionCost final : public ceres::SizedCostFunction<2, 6, 3> {
 public:
  ReprojectionCost(const PoseUpdate* pose, const PinholeCamera* camera, const PixelMeasurement& measurement)
      : pose_(pose), camera_(camera), measurement_(measurement) {}
  bool Evaluate(const double* const* parameters, double* residuals, double** jacobians) const override;

 private:
  const PoseUpdate* pose_;
  const PinholeCamera* camera_;
  PixelMeasurement measurement_;
};

/// The same for a pose that stays fixed. Parameter: point in map (3).
class FixedPoseReprojectionCost final : public ceres::SizedCostFunction<2, 3> {
 public:
  FixedPoseReprojectionCost(const PoseUpdate* pose, const PinholeCamera* camera, const PixelMeasurement& measurement)
      : pose_(pose), camera_(camera), measurement_(measurement) {}
  bool Evaluate(const double* const* parameters, double* residuals, double** jacobians) const override;

 private:
  const PoseUpdate* pose_;
  const PinholeCamera* camera_;
  PixelMeasurement measurement_;
};

}  // namespace portolan
