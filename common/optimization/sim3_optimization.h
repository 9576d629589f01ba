#pragma once

#include <Eigen/Core>
#include <vector>

#include "geometry/camera_model.h"
#include "geometry/rigid3.h"
#include "geometry/sim3.h"

namespace portolan {

/// A feature that shows a landmark, in a camera near frame a or b whose pose in that frame is known.
struct SideView {
  const PinholeCamera* camera = nullptr;
  Rigid3d camera_from_side;  ///< from frame a or b
  Eigen::Vector2d pixel_px;  ///< undistorted
  double sigma_px = 1;       ///< standard deviation: the scale of the feature's pyramid level
};

/// A landmark that was mapped twice, on side a and on side b, and where each side saw it. The first view of each side
/// decides whether it is an inlier. The others tell the scale, which shows only in views away from the other side's
/// camera: two cameras at one point see the same pixels whatever the scale is.
struct Sim3Match {
  Eigen::Vector3d point_in_a, point_in_b;  ///< lengths in units of a and of b
  std::vector<SideView> views_in_a, views_in_b;
};

/// The larger squared error of a match in the first view of each side, in units of sigma: the other side's landmark
/// against what was seen. Infinite behind a camera or without a view.
double Chi2Of(const Sim3Match& match, const Sim3d& b_from_a);

struct Sim3OptimizationOptions {
  bool fix_scale = false;  ///< keeps the scale of the start: for maps whose scale is known
  int rounds = 2;          ///< each starts from the last one's similarity, with outliers of the last left out
  int iterations = 15;     ///< Levenberg-Marquardt steps a round, at most
  double chi2 = 9.21;      ///< squared normalised error of an inlier on each side: 99 % with 2 degrees of freedom
  /// Of Cauchy's loss, sigmas: wider than in bundle adjustment, as the landmarks of both maps carry errors of their own
  /// here.
  double loss_width = 1.0;
};

struct Sim3OptimizationResult {
  Sim3d b_from_a;
  std::vector<bool> inliers;  ///< N
  int num_inliers = 0;
};

/// Refines the similarity between two frames over the reprojection errors on both sides (paper Sec. 5).
/// Model: pixel of a view in b ~ Project(camera, camera_from_b * (b_from_a * point_in_a)),
///        pixel of a view in a ~ Project(camera, camera_from_a * (b_from_a^-1 * point_in_b)).
/// Levenberg-Marquardt on b_from_a <- ExpSim3(d) * b_from_a with analytic Jacobians and Cauchy's loss; landmarks and
/// cameras are held fixed. A match that is behind a camera or not finite is an outlier. Fewer than 3 usable matches
/// leave the similarity as it is, with no inliers. Deterministic.
/// @param matches N.
Sim3OptimizationResult OptimizeSim3(const std::vector<Sim3Match>& matches, const Sim3d& initial_b_from_a,
                                    const Sim3OptimizationOptions& options = {});

/// Residual (u, v) of a view in units of sigma and its derivative by the update d, for the solver and its test: of a
/// point of frame a in a view of b, and of a point of frame b in a view of a. @return false behind the camera.
using Sim3Jacobian = Eigen::Matrix<double, 2, 7>;
bool LinearizeInB(const SideView& view, const Eigen::Vector3d& point_in_a, const Sim3d& b_from_a,
                  Eigen::Vector2d* residual, Sim3Jacobian* jacobian);
bool LinearizeInA(const SideView& view, const Eigen::Vector3d& point_in_b, const Sim3d& b_from_a,
                  Eigen::Vector2d* residual, Sim3Jacobian* jacobian);

}  // namespace portolan
