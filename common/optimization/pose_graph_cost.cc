#include "optimization/pose_graph_cost.h"

#include <cmath>

namespace portolan {

SimilarityUpdate::SimilarityUpdate(const Sim3d& reference_camera_from_map)
    : reference_(reference_camera_from_map), reference_centre_(reference_.Inverse().translation) {
  Prepare();
}

void SimilarityUpdate::Prepare() {
  const Eigen::Vector3d r = update_.segment<3>(3);
  rotation_ = (ExpSO3(r) * reference_.rotation).normalized().toRotationMatrix();
  left_jacobian_ = LeftJacobianSO3(r);
  centre_in_map_ = reference_centre_ + update_.head<3>();
  scale_ = reference_.scale * std::exp(update_[6]);
}

Sim3d SimilarityUpdate::CameraFromMap() const {
  const double scale = reference_.scale * std::exp(update_[6]);
  const Eigen::Quaterniond rotation = (ExpSO3(update_.segment<3>(3)) * reference_.rotation).normalized();
  return Sim3d(scale, rotation, -scale * (rotation * (reference_centre_ + update_.head<3>())));
}

EdgeCost::EdgeCost(const SimilarityUpdate* i, const SimilarityUpdate* j, const PoseGraph::Edge& edge)
    : i_(i),
      j_(j),
      rotation_(edge.j_from_i.rotation.normalized().toRotationMatrix()),
      translation_(edge.j_from_i.translation),
      scale_(edge.j_from_i.scale),
      log_scale_(std::log(edge.j_from_i.scale)),
      weight_(edge.weight),
      inverse_length_(1.0 / edge.length) {}

bool EdgeCost::Evaluate(const double* const* /*parameters*/, double* residuals, double** jacobians) const {
  // E = M S_i S_j^-1: S_j^-1 takes j's origin to its centre c_j, S_i takes that to s_i R_i (c_j - c_i).
  const Eigen::Vector3d j_in_i = i_->scale() * (i_->rotation() * (j_->centre_in_map() - i_->centre_in_map()));
  const Eigen::Matrix3d rotation = rotation_ * i_->rotation() * j_->rotation().transpose();
  Vector7d error;
  error.head<3>() = scale_ * (rotation_ * j_in_i) + translation_;
  error.segment<3>(3) = LogSO3(Eigen::Quaterniond(rotation));
  error[6] = log_scale_ + std::log(i_->scale() / j_->scale());
  Eigen::Map<Vector7d> residual(residuals);
  residual = weight_ * error;
  residual.head<3>() *= inverse_length_;
  if (jacobians == nullptr) return true;
  if (jacobians[0] != nullptr) ByI(j_in_i, error, jacobians[0]);
  if (jacobians[1] != nullptr) ByJ(error, jacobians[1]);
  return true;
}

void EdgeCost::ByI(const Eigen::Vector3d& j_in_i, const Vector7d& error, double* jacobian) const {
  Eigen::Map<Jacobian> by_i(jacobian);
  by_i.setZero();
  const Eigen::Matrix3d scaled = weight_ * inverse_length_ * scale_ * rotation_;
  by_i.block<3, 3>(0, 0) = -i_->scale() * scaled * i_->rotation();
  by_i.block<3, 3>(0, 3) = -scaled * Skew(j_in_i) * i_->left_jacobian();
  by_i.block<3, 1>(0, 6) = scaled * j_in_i;
  // Log(R_M Exp(d) R_i R_j^T) = Log(Exp(R_M d) R_E)
  by_i.block<3, 3>(3, 3) = weight_ * LeftJacobianSO3(error.segment<3>(3)).inverse() * rotation_ * i_->left_jacobian();
  by_i(6, 6) = weight_;
}

void EdgeCost::ByJ(const Vector7d& error, double* jacobian) const {
  Eigen::Map<Jacobian> by_j(jacobian);
  by_j.setZero();
  by_j.block<3, 3>(0, 0) = weight_ * inverse_length_ * scale_ * i_->scale() * rotation_ * i_->rotation();
  // Log(R_E Exp(-d)): the right Jacobian is the left one of the opposite rotation vector.
  by_j.block<3, 3>(3, 3) = -weight_ * LeftJacobianSO3(-error.segment<3>(3)).inverse() * j_->left_jacobian();
  by_j(6, 6) = -weight_;
}

}  // namespace portolan
