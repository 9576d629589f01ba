#include "optimization/reprojection_cost.h"

#include <cmath>

namespace portolan {
namespace {

constexpr double kMinDepth = 1e-9;  // map units; nearer than this a projection is meaningless

using PointJacobian = Eigen::Matrix<double, 2, 3, Eigen::RowMajor>;
using PoseJacobian = Eigen::Matrix<double, 2, 6, Eigen::RowMajor>;

/// A point in the camera's frame, and the derivative of its residual by that point.
struct Projection {
  Eigen::Vector3d rotated;  ///< R X
  PointJacobian by_point_in_camera;
  bool in_front;
};

Projection Project(const PoseUpdate& pose, const PinholeCamera& camera, const PixelMeasurement& measurement,
                   const double* point, double* residuals) {
  Projection projection;
  projection.rotated.noalias() = pose.rotation() * Eigen::Map<const Eigen::Vector3d>(point);
  const Eigen::Vector3d q = projection.rotated + pose.translation();
  projection.in_front = q.z() > kMinDepth;
  if (!projection.in_front) {
    residuals[0] = residuals[1] = kBehindCameraResidual;
    projection.by_point_in_camera.setZero();
    return projection;
  }
  const double inverse_z = 1 / q.z(), x = q.x() * inverse_z, y = q.y() * inverse_z;
  const double u = camera.fx * measurement.inverse_sigma, v = camera.fy * measurement.inverse_sigma;
  residuals[0] = u * x + (camera.cx - measurement.pixel_px.x()) * measurement.inverse_sigma;
  residuals[1] = v * y + (camera.cy - measurement.pixel_px.y()) * measurement.inverse_sigma;
  projection.by_point_in_camera << u * inverse_z, 0, -u * x * inverse_z, 0, v * inverse_z, -v * y * inverse_z;
  return projection;
}

}  // namespace

PoseUpdate::PoseUpdate(const Rigid3d& reference_camera_from_map) : reference_(reference_camera_from_map) {
  Prepare();
}

void PoseUpdate::Prepare() {
  const Rigid3d pose = CameraFromMap();
  rotation_ = pose.rotation.toRotationMatrix();
  translation_ = pose.translation;
  left_jacobian_ = LeftJacobianSO3(update_.tail<3>());
}

Rigid3d PoseUpdate::CameraFromMap() const {
  return Rigid3d((ExpSO3(update_.tail<3>()) * reference_.rotation).normalized(),
                 reference_.translation + update_.head<3>());
}

bool ReprojectionCost::Evaluate(const double* const* parameters, double* residuals, double** jacobians) const {
  const Projection projection = Project(*pose_, *camera_, measurement_, parameters[1], residuals);
  if (jacobians == nullptr) return true;
  if (jacobians[0] != nullptr) {
    // q = Exp(r) R_ref X + t: dq/dt = I, dq/dr = -[R X]x J(r).
    Eigen::Map<PoseJacobian> by_pose(jacobians[0]);
    by_pose.leftCols<3>() = projection.by_point_in_camera;
    PointJacobian by_rotation;  // d residual / dq * -[R X]x, row by row: a^T (-[b]x) = (b x a)^T
    by_rotation.row(0) = projection.rotated.cross(projection.by_point_in_camera.row(0).transpose()).transpose();
    by_rotation.row(1) = projection.rotated.cross(projection.by_point_in_camera.row(1).transpose()).transpose();
    by_pose.rightCols<3>().noalias() = by_rotation * pose_->left_jacobian();
  }
  if (jacobians[1] != nullptr) {
    Eigen::Map<PointJacobian>(jacobians[1]).noalias() = projection.by_point_in_camera * pose_->rotation();
  }
  return true;
}

bool FixedPoseReprojectionCost::Evaluate(const double* const* parameters, double* residuals, double** jacobians) const {
  const Projection projection = Project(*pose_, *camera_, measurement_, parameters[0], residuals);
  if (jacobians != nullptr && jacobians[0] != nullptr) {
    Eigen::Map<PointJacobian>(jacobians[0]).noalias() = projection.by_point_in_camera * pose_->rotation();
  }
  return true;
}

}  // namespace portolan
