#include "optimization/sim3_optimization.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>

namespace portolan {
namespace {

using Matrix7d = Eigen::Matrix<double, 7, 7>;

constexpr int kMinMatches = 3;      // 7 unknowns, 4 equations a match; two leave the rotation about their line free
constexpr double kMinDepth = 1e-9;  // nearer than this a projection is meaningless
constexpr double kInitialDamping = 1e-4;  // relative to the diagonal
constexpr double kFloor = 1e-12;          // of the largest diagonal element: what nothing determines stays as it is
constexpr double kDampingUp = 10, kDampingDown = 0.1, kMaxDamping = 1e6;
constexpr double kMinStep = 1e-8;              // norm of the twist; far below what moves a pixel visibly
constexpr double kMinRelativeDecrease = 1e-5;  // of the cost: what follows is a small share of the similarity's error
constexpr double kInfinity = std::numeric_limits<double>::infinity();

struct NormalEquations {
  Matrix7d hessian = Matrix7d::Zero();
  Vector7d gradient = Vector7d::Zero();
  double cost = 0;
};

double CauchyCost(double squared_error, double width) {
  return width * width * std::log1p(squared_error / (width * width));
}
double CauchyWeight(double squared_error, double width) {
  return 1.0 / (1.0 + squared_error / (width * width));
}

/// (u, v) / sigma of a point in the camera's frame. @return false behind the camera.
bool Residual(const SideView& view, const Eigen::Vector3d& point_in_camera, Eigen::Vector2d* residual) {
  if (!(point_in_camera.z() > kMinDepth)) return false;
  *residual = (view.camera->Project(point_in_camera) - view.pixel_px) / view.sigma_px;
  return true;
}

/// d residual / d point_in_camera.
Eigen::Matrix<double, 2, 3> ProjectionJacobian(const SideView& view, const Eigen::Vector3d& point) {
  const double inverse_z = 1 / point.z(), x = point.x() * inverse_z, y = point.y() * inverse_z;
  const double u = view.camera->fx * inverse_z / view.sigma_px, v = view.camera->fy * inverse_z / view.sigma_px;
  Eigen::Matrix<double, 2, 3> jacobian;
  jacobian << u, 0, -u * x, 0, v, -v * y;
  return jacobian;
}

/// The squared error of a point of a side in the first of its views; infinite behind the camera.
double ErrorInFirst(const std::vector<SideView>& views, const Eigen::Vector3d& point_in_side) {
  Eigen::Vector2d residual;
  if (views.empty() || !Residual(views[0], views[0].camera_from_side * point_in_side, &residual)) return kInfinity;
  return residual.squaredNorm();
}

/// d (ExpSim3(d) * p) / dd at d = 0.
Eigen::Matrix<double, 3, 7> GeneratorsAt(const Eigen::Vector3d& p) {
  Eigen::Matrix<double, 3, 7> generators;
  generators << Eigen::Matrix3d::Identity(), -Skew(p), p;
  return generators;
}

/// The solver over a set of matches.
class Sim3Solver {
 public:
  Sim3Solver(const std::vector<Sim3Match>& matches, const Sim3OptimizationOptions& options)
      : matches_(matches), options_(options), inliers_(matches.size()) {}

  /// Marks the matches within chi2 as inliers. @return how many.
  int Classify(const Sim3d& b_from_a, double chi2) {
    for (size_t i = 0; i < matches_.size(); ++i) inliers_[i] = Chi2Of(matches_[i], b_from_a) <= chi2;
    return static_cast<int>(std::count(inliers_.begin(), inliers_.end(), true));
  }

  /// Levenberg-Marquardt over the inliers.
  Sim3d Minimize(Sim3d b_from_a) const {
    double damping = kInitialDamping;
    NormalEquations at = Linearize(b_from_a);
    for (int i = 0; i < options_.iterations && damping < kMaxDamping; ++i) {
      Matrix7d damped = at.hessian;
      damped.diagonal() *= 1 + damping;
      damped.diagonal().array() += kFloor * at.hessian.diagonal().maxCoeff();
      const Vector7d step = -damped.ldlt().solve(at.gradient);
      if (!step.allFinite()) break;
      const Sim3d candidate = ExpSim3(step) * b_from_a;
      const double cost = Cost(candidate);
      if (!(cost <= at.cost)) {
        damping *= kDampingUp;
        continue;
      }
      b_from_a = candidate;
      if (step.norm() < kMinStep || at.cost - cost <= kMinRelativeDecrease * at.cost) break;
      damping *= kDampingDown;
      at = Linearize(b_from_a);
    }
    return b_from_a;
  }

  const std::vector<bool>& inliers() const { return inliers_; }

 private:
  NormalEquations Linearize(const Sim3d& b_from_a) const {
    NormalEquations sums;
    Eigen::Vector2d residual;
    Sim3Jacobian jacobian;
    for (size_t i = 0; i < matches_.size(); ++i) {
      if (!inliers_[i]) continue;
      for (const SideView& view : matches_[i].views_in_b) {
        if (LinearizeInB(view, matches_[i].point_in_a, b_from_a, &residual, &jacobian)) Add(residual, jacobian, &sums);
      }
      for (const SideView& view : matches_[i].views_in_a) {
        if (LinearizeInA(view, matches_[i].point_in_b, b_from_a, &residual, &jacobian)) Add(residual, jacobian, &sums);
      }
    }
    if (options_.fix_scale) {
      sums.hessian.row(6).setZero();
      sums.hessian.col(6).setZero();
      sums.hessian(6, 6) = 1;
      sums.gradient[6] = 0;
    }
    return sums;
  }

  void Add(const Eigen::Vector2d& residual, const Sim3Jacobian& jacobian, NormalEquations* sums) const {
    const double squared = residual.squaredNorm(), weight = CauchyWeight(squared, options_.loss_width);
    sums->hessian.noalias() += weight * jacobian.transpose() * jacobian;
    sums->gradient.noalias() += weight * jacobian.transpose() * residual;
    sums->cost += CauchyCost(squared, options_.loss_width);
  }

  /// Inliers that fall behind the first camera of a side make it infinite: no step may put them there.
  double Cost(const Sim3d& b_from_a) const {
    const Sim3d a_from_b = b_from_a.Inverse();
    double cost = 0;
    for (size_t i = 0; i < matches_.size(); ++i) {
      if (!inliers_[i]) continue;
      cost += CostIn(matches_[i].views_in_b, b_from_a * matches_[i].point_in_a);
      cost += CostIn(matches_[i].views_in_a, a_from_b * matches_[i].point_in_b);
    }
    return cost;
  }

  double CostIn(const std::vector<SideView>& views, const Eigen::Vector3d& point_in_side) const {
    double cost = 0;
    for (size_t i = 0; i < views.size(); ++i) {
      Eigen::Vector2d residual;
      if (Residual(views[i], views[i].camera_from_side * point_in_side, &residual)) {
        cost += CauchyCost(residual.squaredNorm(), options_.loss_width);
      } else if (i == 0) {
        return kInfinity;
      }
    }
    return cost;
  }

  const std::vector<Sim3Match>& matches_;
  const Sim3OptimizationOptions& options_;
  std::vector<bool> inliers_;
};

}  // namespace

double Chi2Of(const Sim3Match& match, const Sim3d& b_from_a) {
  const double in_b = ErrorInFirst(match.views_in_b, b_from_a * match.point_in_a);
  const double in_a = ErrorInFirst(match.views_in_a, b_from_a.Inverse() * match.point_in_b);
  return in_a <= in_b ? in_b : in_a;  // NaN, if one is, for NaN is within nothing
}

bool LinearizeInB(const SideView& view, const Eigen::Vector3d& point_in_a, const Sim3d& b_from_a,
                  Eigen::Vector2d* residual, Sim3Jacobian* jacobian) {
  const Eigen::Vector3d in_b = b_from_a * point_in_a;
  const Eigen::Vector3d in_camera = view.camera_from_side * in_b;
  if (!Residual(view, in_camera, residual)) return false;
  *jacobian =
      ProjectionJacobian(view, in_camera) * view.camera_from_side.rotation.toRotationMatrix() * GeneratorsAt(in_b);
  return true;
}

bool LinearizeInA(const SideView& view, const Eigen::Vector3d& point_in_b, const Sim3d& b_from_a,
                  Eigen::Vector2d* residual, Sim3Jacobian* jacobian) {
  const Sim3d a_from_b = b_from_a.Inverse();
  const Eigen::Vector3d in_camera = view.camera_from_side * (a_from_b * point_in_b);
  if (!Residual(view, in_camera, residual)) return false;
  // a_from_b <- a_from_b * ExpSim3(-d): the generators act on point_in_b, then a_from_b without its translation.
  const Eigen::Matrix3d linear =
      a_from_b.scale * (view.camera_from_side.rotation * a_from_b.rotation).toRotationMatrix();
  *jacobian = -(ProjectionJacobian(view, in_camera) * linear * GeneratorsAt(point_in_b));
  return true;
}

Sim3OptimizationResult OptimizeSim3(const std::vector<Sim3Match>& matches, const Sim3d& initial_b_from_a,
                                    const Sim3OptimizationOptions& options) {
  Sim3OptimizationResult result;
  result.b_from_a = initial_b_from_a;
  result.inliers.assign(matches.size(), false);
  Sim3Solver solver(matches, options);
  // At first all that is in front of its cameras counts, however far off: the loss deals with it.
  if (solver.Classify(initial_b_from_a, std::numeric_limits<double>::max()) < kMinMatches) return result;
  Sim3d b_from_a = initial_b_from_a;
  int count = 0;
  for (int round = 0; round < options.rounds; ++round) {
    b_from_a = solver.Minimize(b_from_a);
    count = solver.Classify(b_from_a, options.chi2);
    if (count < kMinMatches) return result;
  }
  result.b_from_a = b_from_a;
  result.inliers = solver.inliers();
  result.num_inliers = count;
  return result;
}

}  // namespace portolan
