#pragma once

#include <ceres/sized_cost_function.h>

#include <Eigen/Core>

#include "geometry/sim3.h"
#include "optimization/pose_graph.h"

namespace portolan {

/// A node during optimisation: a small update (3 of the centre, a rotation vector, 1 of the logarithm of the scale) on
/// a reference,
///   camera_from_map: rotation Exp(r) R_ref, centre c_ref + c, scale exp(a) s_ref.
/// The update is the parameter block of the solver. All edges of a node share this object, so that its rotation matrix
/// is computed once per evaluation; Prepare() must be called when the update has changed.
class SimilarityUpdate {
 public:
  explicit SimilarityUpdate(const Sim3d& reference_camera_from_map);

  double* parameters() { return update_.data(); }
  const double* parameters() const { return update_.data(); }
  void Prepare();
  /// The similarity at the present parameters.
  Sim3d CameraFromMap() const;

  const Eigen::Matrix3d& rotation() const { return rotation_; }
  const Eigen::Vector3d& centre_in_map() const { return centre_in_map_; }
  double scale() const { return scale_; }
  /// J of Exp(r + d) = Exp(J d) Exp(r) to first order.
  const Eigen::Matrix3d& left_jacobian() const { return left_jacobian_; }

 private:
  Sim3d reference_;
  Eigen::Vector3d reference_centre_;
  Vector7d update_ = Vector7d::Zero();
  Eigen::Matrix3d rotation_, left_jacobian_;
  Eigen::Vector3d centre_in_map_;
  double scale_ = 1.0;
};

/// The residual of an edge (see EdgeResidual) with analytic Jacobians. Parameters: updates of i and of j (7 each);
/// their values are read from the prepared SimilarityUpdates.
class EdgeCost final : public ceres::SizedCostFunction<7, 7, 7> {
 public:
  EdgeCost(const SimilarityUpdate* i, const SimilarityUpdate* j, const PoseGraph::Edge& edge);
  bool Evaluate(const double* const* parameters, double* residuals, double** jacobians) const override;

 private:
  using Jacobian = Eigen::Matrix<double, 7, 7, Eigen::RowMajor>;
  void ByI(const Eigen::Vector3d& j_in_i, const Vector7d& error, double* jacobian) const;
  void ByJ(const Vector7d& error, double* jacobian) const;

  const SimilarityUpdate* i_;
  const SimilarityUpdate* j_;
  Eigen::Matrix3d rotation_;  // of j_from_i
  Eigen::Vector3d translation_;
  double scale_, log_scale_, weight_, inverse_length_;
};

}  // namespace portolan
