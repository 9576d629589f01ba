#include "geometry/epipolar_refinement.h"

#include <Eigen/Cholesky>
#include <array>
#include <cmath>

namespace portolan {
namespace {

constexpr int kMaxSteps = 20;
constexpr double kInitialDamping = 1e-6, kDampingUp = 10, kDampingDown = 0.1, kMaxDamping = 1e4;
constexpr double kMinRelativeDecrease = 1e-6;  // of the cost: far below what moves a point by a pixel

using Vector5d = Eigen::Matrix<double, 5, 1>;
using Matrix5d = Eigen::Matrix<double, 5, 5>;

/// E = [t]x R and its derivatives by the five parameters.
struct EssentialWithDerivatives {
  explicit EssentialWithDerivatives(const Rigid3d& motion) {
    const Eigen::Matrix3d rotation = motion.rotation.toRotationMatrix();
    const Eigen::Matrix3d cross = Skew(motion.translation);
    const Eigen::Matrix<double, 3, 2> basis = TangentBasis(motion.translation);
    value = cross * rotation;
    for (int i = 0; i < 2; ++i) derivatives[i] = Skew(basis.col(i)) * rotation;
    for (int i = 0; i < 3; ++i) derivatives[2 + i] = cross * Skew(Eigen::Vector3d::Unit(i)) * rotation;
  }
  Eigen::Matrix3d value;
  std::array<Eigen::Matrix3d, 5> derivatives;
};

/// d = p / s with p = x2^T E x1 and s^2 = |(E x1)_12|^2 + |(E^T x2)_12|^2; so d' = p'/s - d s'/s, s s' = (s^2)'/2.
double Sampson(const EssentialWithDerivatives& E, const Eigen::Vector2d& first_xy, const Eigen::Vector2d& second_xy,
               Vector5d* gradient) {
  const Eigen::Vector3d x1 = first_xy.homogeneous(), x2 = second_xy.homogeneous();
  const Eigen::Vector3d l2 = E.value * x1;
  const Eigen::Vector2d l1 = E.value.leftCols<2>().transpose() * x2;
  const double inverse_s2 = 1 / (l2.head<2>().squaredNorm() + l1.squaredNorm());
  const double inverse_s = std::sqrt(inverse_s2);
  const double distance = x2.dot(l2) * inverse_s;
  if (gradient != nullptr) {
    for (int i = 0; i < 5; ++i) {
      const Eigen::Vector3d dl2 = E.derivatives[i] * x1;
      const Eigen::Vector2d dl1 = E.derivatives[i].leftCols<2>().transpose() * x2;
      const double half_ds2 = l2.head<2>().dot(dl2.head<2>()) + l1.dot(dl1);
      (*gradient)[i] = x2.dot(dl2) * inverse_s - distance * half_ds2 * inverse_s2;
    }
  }
  return distance;
}

struct Linearization {
  Matrix5d hessian = Matrix5d::Zero();
  Vector5d gradient = Vector5d::Zero();
  double cost = 0;
};

Linearization Linearize(const Rigid3d& motion, const std::vector<Eigen::Vector2d>& first_xy,
                        const std::vector<Eigen::Vector2d>& second_xy, double max_distance) {
  const EssentialWithDerivatives E(motion);
  Linearization sums;
  for (size_t i = 0; i < first_xy.size(); ++i) {
    const double distance = Sampson(E, first_xy[i], second_xy[i], nullptr);
    if (!(std::abs(distance) < max_distance)) {
      sums.cost += max_distance * max_distance;
      continue;
    }
    Vector5d gradient;
    Sampson(E, first_xy[i], second_xy[i], &gradient);
    sums.cost += distance * distance;
    sums.gradient += distance * gradient;
    sums.hessian.noalias() += gradient * gradient.transpose();
  }
  return sums;
}

}  // namespace

Eigen::Matrix<double, 3, 2> TangentBasis(const Eigen::Vector3d& unit) {
  int smallest = 0;
  unit.cwiseAbs().minCoeff(&smallest);
  Eigen::Matrix<double, 3, 2> basis;
  basis.col(0) = unit.cross(Eigen::Vector3d::Unit(smallest)).normalized();
  basis.col(1) = unit.cross(basis.col(0));
  return basis;
}

Rigid3d MoveOnEssentialManifold(const Rigid3d& second_from_first, const Vector5d& step) {
  const Eigen::Vector3d& t = second_from_first.translation;
  return Rigid3d((ExpSO3(step.tail<3>()) * second_from_first.rotation).normalized(),
                 (t + TangentBasis(t) * step.head<2>()).normalized());
}

double SampsonDistance(const Rigid3d& second_from_first, const Eigen::Vector2d& first_xy,
                       const Eigen::Vector2d& second_xy, Vector5d* gradient) {
  return Sampson(EssentialWithDerivatives(second_from_first), first_xy, second_xy, gradient);
}

Rigid3d RefineMotion(const Rigid3d& second_from_first, const std::vector<Eigen::Vector2d>& first_xy,
                     const std::vector<Eigen::Vector2d>& second_xy, double max_distance) {
  Rigid3d motion(second_from_first.rotation, second_from_first.translation.normalized());
  Linearization at_motion = Linearize(motion, first_xy, second_xy, max_distance);
  double damping = kInitialDamping;
  for (int i = 0; i < kMaxSteps && damping < kMaxDamping; ++i) {
    Matrix5d damped = at_motion.hessian;
    damped.diagonal() *= 1 + damping;
    const Vector5d step = -damped.ldlt().solve(at_motion.gradient);
    if (!step.allFinite()) break;
    const Rigid3d candidate = MoveOnEssentialManifold(motion, step);
    const Linearization at_candidate = Linearize(candidate, first_xy, second_xy, max_distance);
    if (!(at_candidate.cost <= at_motion.cost)) {
      damping *= kDampingUp;
      continue;
    }
    const bool settled = at_motion.cost - at_candidate.cost <= kMinRelativeDecrease * at_motion.cost;
    motion = candidate;
    at_motion = at_candidate;
    if (settled) break;
    damping *= kDampingDown;
  }
  return motion;
}

}  // namespace portolan
