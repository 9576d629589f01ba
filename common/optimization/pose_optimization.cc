#include "optimization/pose_optimization.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>

#include "base/check.h"

namespace portolan {
namespace {

constexpr int kMinMatches = 3;      // 6 unknowns, 2 equations a match
constexpr double kMinDepth = 1e-9;  // map units; nearer than this a projection is meaningless
// Relative to the diagonal: nearly Gauss-Newton, as the start is usually close.
constexpr double kInitialDamping = 1e-6;
constexpr double kDampingUp = 10, kDampingDown = 0.1, kMaxDamping = 1e6;
constexpr double kMinStep = 1e-6;  // norm of the twist; far below what moves a pixel visibly
// Of the cost: what follows moves the pose by a hundredth of its standard deviation.
constexpr double kMinRelativeDecrease = 1e-4;

/// One usable match, packed for the inner loop.
struct Term {
  Eigen::Vector3d landmark;
  Eigen::Vector2d pixel;
  double inverse_sigma;
  bool inlier;
};

/// J^T W J, J^T W r and the robust cost over the inliers.
struct NormalEquations {
  Matrix6d hessian;
  Vector6d gradient;
  double cost;
};

/// The camera as the inner loop wants it.
struct PosedCamera {
  PosedCamera(const PinholeCamera& c, const Rigid3d& pose)
      : rotation(pose.rotation.toRotationMatrix()), translation(pose.translation), camera(c) {}

  /// @return false behind the camera. `residual` in units of sigma.
  bool Residual(const Term& term, Eigen::Vector3d* point_in_camera, Eigen::Vector2d* residual) const {
    point_in_camera->noalias() = rotation * term.landmark;
    *point_in_camera += translation;
    if (!(point_in_camera->z() > kMinDepth)) return false;
    *residual = (camera.Project(*point_in_camera) - term.pixel) * term.inverse_sigma;
    return true;
  }

  Eigen::Matrix3d rotation;
  Eigen::Vector3d translation;
  PinholeCamera camera;
};

/// Cauchy's cost of a squared error, and its weight: the derivative.
double CauchyCost(double squared_error, double width) {
  return width * width * std::log1p(squared_error / (width * width));
}
// While the loss is wide. A round of some hundred matches ends well within a quarter of its width.
constexpr double kNarrowing = 4;  // from round to round
// Of the next round's loss: what is farther off has a tenth of the weight, and is out.
constexpr double kGateWidths = 3;

double CauchyWeight(double squared_error, double width) {
  return 1.0 / (1.0 + squared_error / (width * width));
}

/// Adds weight * row^T row to the upper triangle and weight * row * residual to the gradient.
void AddRow(const double (&row)[6], double residual, double weight, NormalEquations* sums) {
  for (int i = 0; i < 6; ++i) {
    const double weighted = weight * row[i];
    sums->gradient[i] += weighted * residual;
    for (int j = i; j < 6; ++j) sums->hessian(i, j) += weighted * row[j];
  }
}

/// Linearises at a pose. For q = R X + t, d = (rho, phi) on the left: dq = rho + phi x q, and
/// d pixel / dq = [fx/z 0 -fx x/z^2; 0 fy/z -fy y/z^2].
NormalEquations Linearize(const PinholeCamera& camera, const Rigid3d& pose, const std::vector<Term>& terms,
                          double width) {
  NormalEquations sums{Matrix6d::Zero(), Vector6d::Zero(), 0};
  const PosedCamera posed(camera, pose);
  for (const Term& term : terms) {
    Eigen::Vector3d q;
    Eigen::Vector2d r;
    if (!term.inlier || !posed.Residual(term, &q, &r)) continue;
    const double e2 = r.squaredNorm();
    const double weight = CauchyWeight(e2, width);
    const double inverse_z = 1 / q.z(), x = q.x() * inverse_z, y = q.y() * inverse_z;
    const double u = camera.fx * term.inverse_sigma, v = camera.fy * term.inverse_sigma;
    const double row_u[6] = {u * inverse_z, 0, -u * x * inverse_z, -u * x * y, u * (1 + x * x), -u * y};
    const double row_v[6] = {0, v * inverse_z, -v * y * inverse_z, -v * (1 + y * y), v * x * y, v * x};
    AddRow(row_u, r.x(), weight, &sums);
    AddRow(row_v, r.y(), weight, &sums);
    sums.cost += CauchyCost(e2, width);
  }
  sums.hessian.triangularView<Eigen::StrictlyLower>() = sums.hessian.transpose();
  return sums;
}

/// The robust cost of a pose. Inliers that fall behind the camera make it infinite: no step may put them there.
double Cost(const PinholeCamera& camera, const Rigid3d& pose, const std::vector<Term>& terms, double width) {
  const PosedCamera posed(camera, pose);
  double cost = 0;
  for (const Term& term : terms) {
    if (!term.inlier) continue;
    Eigen::Vector3d q;
    Eigen::Vector2d r;
    if (!posed.Residual(term, &q, &r)) return std::numeric_limits<double>::infinity();
    cost += CauchyCost(r.squaredNorm(), width);
  }
  return cost;
}

/// One round of Levenberg-Marquardt over the inliers.
Rigid3d MinimizeOverPose(const PinholeCamera& camera, Rigid3d pose, const std::vector<Term>& terms, double width,
                         int iterations) {
  double damping = kInitialDamping;
  NormalEquations at_pose = Linearize(camera, pose, terms, width);
  for (int i = 0; i < iterations && damping < kMaxDamping; ++i) {
    Matrix6d damped = at_pose.hessian;
    damped.diagonal() *= 1 + damping;
    const Vector6d step = -damped.ldlt().solve(at_pose.gradient);
    if (!step.allFinite()) break;
    const Rigid3d candidate = ExpSE3(step) * pose;
    const double cost = Cost(camera, candidate, terms, width);
    if (cost > at_pose.cost) {
      damping *= kDampingUp;
      continue;
    }
    pose = candidate;
    if (step.norm() < kMinStep || at_pose.cost - cost <= kMinRelativeDecrease * at_pose.cost) break;
    damping *= kDampingDown;
    at_pose = Linearize(camera, pose, terms, width);
  }
  return pose;
}

/// Marks the terms within chi2 of their pixel. @return how many. `changed` tells whether any mark did.
int ClassifyInliers(const PinholeCamera& camera, const Rigid3d& pose, double chi2, std::vector<Term>* terms,
                    bool* changed) {
  const PosedCamera posed(camera, pose);
  int count = 0;
  *changed = false;
  for (Term& term : *terms) {
    Eigen::Vector3d q;
    Eigen::Vector2d r;
    const bool inlier = posed.Residual(term, &q, &r) && r.squaredNorm() <= chi2;
    *changed = *changed || inlier != term.inlier;
    term.inlier = inlier;
    count += inlier ? 1 : 0;
  }
  return count;
}

/// The usable matches; those in front of the camera start as inliers. `index` maps a term to its match.
std::vector<Term> MakeTerms(const PinholeCamera& camera, const PoseMatches& matches, const Rigid3d& pose,
                            std::vector<size_t>* index) {
  const size_t n = matches.landmarks_in_map.size();
  PORTOLAN_CHECK(matches.pixels_px.size() == n && matches.sigmas_px.size() == n)
      << n << " landmarks, " << matches.pixels_px.size() << " pixels, " << matches.sigmas_px.size() << " sigmas";
  const PosedCamera posed(camera, pose);
  std::vector<Term> terms;
  terms.reserve(n);
  index->reserve(n);
  for (size_t i = 0; i < n; ++i) {
    const double sigma = matches.sigmas_px[i];
    if (!matches.landmarks_in_map[i].allFinite() || !matches.pixels_px[i].allFinite() || !(sigma > 0)) continue;
    Term term{matches.landmarks_in_map[i], matches.pixels_px[i], 1 / sigma, true};
    Eigen::Vector3d q;
    Eigen::Vector2d r;
    term.inlier = posed.Residual(term, &q, &r);
    terms.push_back(term);
    index->push_back(i);
  }
  return terms;
}

}  // namespace

PoseOptimizationResult OptimizePose(const PinholeCamera& camera, const PoseMatches& matches,
                                    const Rigid3d& initial_camera_from_map, const PoseOptimizationOptions& options) {
  PoseOptimizationResult result;
  result.camera_from_map = initial_camera_from_map;
  result.inliers.assign(matches.landmarks_in_map.size(), false);
  std::vector<size_t> index;
  std::vector<Term> terms = MakeTerms(camera, matches, initial_camera_from_map, &index);
  int count = static_cast<int>(std::count_if(terms.begin(), terms.end(), [](const Term& term) { return term.inlier; }));
  if (count < kMinMatches) return result;

  Rigid3d pose = initial_camera_from_map;
  double width = std::max(options.first_loss_width, options.loss_width);
  for (int round = 0; round < options.rounds; ++round) {
    pose = MinimizeOverPose(camera, pose, terms, width, options.iterations);
    const bool is_last_width = width <= options.loss_width;
    width = std::max(width / kNarrowing, options.loss_width);
    const double gate =
        is_last_width ? options.chi2 : std::max(options.chi2, kGateWidths * kGateWidths * width * width);
    bool changed = false;
    count = ClassifyInliers(camera, pose, gate, &terms, &changed);
    if (count < kMinMatches) return result;
    if (!changed && is_last_width) break;
  }

  result.camera_from_map = pose;
  result.num_inliers = count;
  for (size_t i = 0; i < terms.size(); ++i) result.inliers[index[i]] = terms[i].inlier;
  result.information = Linearize(camera, pose, terms, options.loss_width).hessian;
  return result;
}

}  // namespace portolan
