#include "optimization/lens_adjustment.h"

#include <ceres/ceres.h>
#include <ceres/rotation.h>

#include <algorithm>
#include <array>
#include <memory>
#include <vector>

#include "base/check.h"
#include "optimization/reprojection_cost.h"

namespace portolan {
namespace {

/// Reprojection error in sigmas through a lens. Parameters: pose (rotation vector, translation), point in map, lens
/// (k1, k2, and what the focal length is more than the camera's, as a share).
struct LensReprojection {
  const PinholeCamera* camera;
  Eigen::Vector2d pixel_px;
  double inverse_sigma;

  template <class T>
  bool operator()(const T* pose, const T* point_in_map, const T* lens, T* error) const {
    T q[3];
    ceres::AngleAxisRotatePoint(pose, point_in_map, q);
    for (int i = 0; i < 3; ++i) q[i] += pose[3 + i];
    if (!(q[2] > T(0))) {
      error[0] = error[1] = T(kBehindCameraResidual);
      return true;
    }
    const T x = q[0] / q[2], y = q[1] / q[2], r2 = x * x + y * y;
    const T scale = (1.0 + r2 * (lens[0] + r2 * lens[1])) * (1.0 + lens[2]);
    error[0] = (camera->fx * x * scale + camera->cx - pixel_px.x()) * inverse_sigma;
    error[1] = (camera->fy * y * scale + camera->cy - pixel_px.y()) * inverse_sigma;
    return true;
  }
};

using PoseBlock = std::array<double, 6>;

PoseBlock ToBlock(const Rigid3d& pose) {
  PoseBlock block{};
  const Eigen::Vector3d rotation = LogSO3(pose.rotation);
  std::copy_n(rotation.data(), 3, block.data());
  std::copy_n(pose.translation.data(), 3, block.data() + 3);
  return block;
}

}  // namespace

std::optional<LensAdjustment> AdjustLens(const BundleProblem& problem, const BundleOptions& options,
                                         const RadialResidual& known) {
  if (problem.measurements.empty()) return std::nullopt;
  std::vector<PoseBlock> poses;
  for (const BundleProblem::Pose& pose : problem.poses) {
    PORTOLAN_CHECK(pose.camera == problem.poses.front().camera) << "more than one camera";
    poses.push_back(ToBlock(pose.camera_from_map));
  }
  std::vector<Eigen::Vector3d> points = problem.points_in_map;
  std::array<double, 3> lens{known.k1, known.k2, 0};
  ceres::CauchyLoss loss(options.loss_width);
  ceres::Problem::Options problem_options;
  problem_options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ceres::Problem solved(problem_options);
  ceres::ParameterBlockOrdering ordering;
  for (const BundleProblem::Measurement& m : problem.measurements) {
    auto cost =
        std::make_unique<LensReprojection>(LensReprojection{&problem.poses[m.pose].camera, m.pixel_px, 1 / m.sigma_px});
    solved.AddResidualBlock(new ceres::AutoDiffCostFunction<LensReprojection, 2, 6, 3, 3>(cost.release()),
                            options.robust ? &loss : nullptr, poses[m.pose].data(), points[m.point].data(),
                            lens.data());
    ordering.AddElementToGroup(points[m.point].data(), 0);
    ordering.AddElementToGroup(poses[m.pose].data(), 1);
  }
  ordering.AddElementToGroup(lens.data(), 1);
  for (size_t i = 0; i < poses.size(); ++i) {
    if (problem.poses[i].fixed && solved.HasParameterBlock(poses[i].data()))
      solved.SetParameterBlockConstant(poses[i].data());
  }
  ceres::Solver::Options solver;
  solver.linear_solver_type = ceres::DENSE_SCHUR;
  solver.max_num_iterations = options.max_iterations;
  solver.function_tolerance = options.function_tolerance;
  solver.num_threads = options.num_threads;
  solver.logging_type = ceres::SILENT;
  const auto solve = [&] {
    solver.linear_solver_ordering =
        std::make_shared<ceres::ParameterBlockOrdering>(ordering);  // the solver strikes out what is constant
    ceres::Solver::Summary summary;
    ceres::Solve(solver, &solved, &summary);
    return summary;
  };
  solved.SetParameterBlockConstant(lens.data());
  const ceres::Solver::Summary without = solve();
  if (!without.IsSolutionUsable()) return std::nullopt;
  solved.SetParameterBlockVariable(lens.data());
  const auto solve_holding = [&](const std::vector<int>& held) {
    lens = {known.k1, known.k2, 0};
    solved.SetManifold(lens.data(), new ceres::SubsetManifold(static_cast<int>(lens.size()), held));
    return solve();
  };
  const ceres::Solver::Summary focal = solve_holding({0, 1});
  if (!focal.IsSolutionUsable()) return std::nullopt;
  const ceres::Solver::Summary with = solve_holding({2});
  if (!with.IsSolutionUsable()) return std::nullopt;
  return LensAdjustment{{lens[0], lens[1]}, without.final_cost, with.final_cost, focal.final_cost};
}

}  // namespace portolan
