#include "optimization/point_optimization.h"

#include <Eigen/Cholesky>
#include <cmath>

#include "optimization/reprojection_cost.h"

namespace portolan {
namespace {

constexpr double kFirstDamping = 1e-4;
constexpr double kMaxDamping = 1e6;  // steps this small change nothing any more
constexpr double kConverged = 1e-4;  // relative decrease of the loss at which it is done

/// Of a sighting at a point: false behind the camera.
bool Linearize(const PointSighting& sighting, const Eigen::Vector3d& point, Eigen::Vector2d* residual,
               Eigen::Matrix<double, 2, 3>* jacobian) {
  const PointView& view = *sighting.view;
  const Eigen::Vector3d q = view.rotation * point + view.translation;
  if (!(q.z() > 0)) return false;
  const double inverse_sigma = 1 / sighting.sigma_px, inverse_z = 1 / q.z();
  *residual = inverse_sigma * (view.camera.Project(q) - sighting.pixel_px);
  if (jacobian == nullptr) return true;
  const double u = view.camera.fx * inverse_sigma * inverse_z, v = view.camera.fy * inverse_sigma * inverse_z;
  Eigen::Matrix<double, 2, 3> by_q;
  by_q << u, 0, -u * q.x() * inverse_z, 0, v, -v * q.y() * inverse_z;
  *jacobian = by_q * view.rotation;
  return true;
}

struct NormalEquations {
  Eigen::Matrix3d hessian = Eigen::Matrix3d::Zero();
  Eigen::Vector3d gradient = Eigen::Vector3d::Zero();
};

NormalEquations Accumulate(const std::vector<PointSighting>& sightings, const Eigen::Vector3d& point, double width) {
  NormalEquations equations;
  for (const PointSighting& sighting : sightings) {
    Eigen::Vector2d residual;
    Eigen::Matrix<double, 2, 3> jacobian;
    if (!Linearize(sighting, point, &residual, &jacobian)) continue;
    const double weight = 1 / (1 + residual.squaredNorm() / (width * width));
    equations.hessian += weight * jacobian.transpose() * jacobian;
    equations.gradient += weight * jacobian.transpose() * residual;
  }
  return equations;
}

}  // namespace

double PointLoss(const std::vector<PointSighting>& sightings, const Eigen::Vector3d& point_in_map, double loss_width) {
  const double squared_width = loss_width * loss_width;
  double loss = 0;
  for (const PointSighting& sighting : sightings) {
    Eigen::Vector2d residual(kBehindCameraResidual, kBehindCameraResidual);
    Linearize(sighting, point_in_map, &residual, nullptr);
    loss += 0.5 * squared_width * std::log1p(residual.squaredNorm() / squared_width);
  }
  return loss;
}

Eigen::Vector3d OptimizePoint(const std::vector<PointSighting>& sightings, const Eigen::Vector3d& initial_in_map,
                              const PointOptimizationOptions& options) {
  Eigen::Vector3d point = initial_in_map;
  if (sightings.size() < 2) return point;
  double loss = PointLoss(sightings, point, options.loss_width), damping = kFirstDamping;
  for (int iteration = 0; iteration < options.iterations; ++iteration) {
    const NormalEquations equations = Accumulate(sightings, point, options.loss_width);
    bool improved = false;
    for (; !improved && damping < kMaxDamping; damping *= improved ? 0.1 : 10) {
      Eigen::Matrix3d damped = equations.hessian;
      damped.diagonal() *= 1 + damping;
      const Eigen::Vector3d next = point - damped.ldlt().solve(equations.gradient);
      const double next_loss = next.allFinite() ? PointLoss(sightings, next, options.loss_width) : loss;
      improved = next_loss < loss;
      if (!improved) continue;
      const bool converged = loss - next_loss < kConverged * loss;
      point = next;
      loss = next_loss;
      if (converged) return point;
    }
    if (!improved) break;
  }
  return point;
}

}  // namespace portolan
