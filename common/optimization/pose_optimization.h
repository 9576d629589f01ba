#pragma once

#include <Eigen/Core>
#include <vector>

#include "geometry/camera_model.h"
#include "geometry/rigid3.h"
#include "optimization/bundle_adjustment.h"

namespace portolan {

struct PoseOptimizationOptions {
  int rounds = 4;       ///< each starts from the last one's pose, with outliers of the last left out
  int iterations = 10;  ///< Gauss-Newton steps a round, at most
  double chi2 = 5.991;  ///< squared normalised error of an inlier: 95 % of a chi-square with 2 degrees of freedom
  double loss_width = kReprojectionLossWidth;  ///< of Cauchy's loss, sigmas
  /// Of the first round; it narrows to loss_width by a factor of 4 a round. Wider where the start may be far off: to a
  /// narrow loss matches that are wrong, but happen to lie near their projection, are the only ones that count.
  double first_loss_width = kReprojectionLossWidth;
};

/// Matches for motion-only BA: N landmarks and their pixels.
struct PoseMatches {
  std::vector<Eigen::Vector3d> landmarks_in_map;  ///< N, map units
  std::vector<Eigen::Vector2d> pixels_px;         ///< N, undistorted
  std::vector<double> sigmas_px;                  ///< N, scale of the feature's pyramid level
};

struct PoseOptimizationResult {
  Rigid3d camera_from_map;
  std::vector<bool> inliers;  ///< N
  int num_inliers = 0;
  /// J^T W J at the solution, over inliers, W of the loss; twist order as in rigid3.h.
  Matrix6d information = Matrix6d::Zero();
};

/// Motion-only BA (paper Sec. 3.2): minimises the robust reprojection error (Cauchy) over the pose, landmarks held
/// fixed. Levenberg-Marquardt on camera_from_map <- ExpSE3(d) * camera_from_map with analytic Jacobians. Points behind
/// the camera are outliers. Fewer than 3 usable matches leave the pose as it is, with no inliers. Deterministic.
PoseOptimizationResult OptimizePose(const PinholeCamera& camera, const PoseMatches& matches,
                                    const Rigid3d& initial_camera_from_map,
                                    const PoseOptimizationOptions& options = {});

}  // namespace portolan
