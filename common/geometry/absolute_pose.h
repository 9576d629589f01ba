#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "base/result.h"
#include "geometry/camera_model.h"
#include "geometry/rigid3.h"

namespace portolan {

struct AbsolutePoseOptions {
  double max_error_px = 4.0;  ///< of an inlier, at the feature's own pyramid level scale
  int min_inliers = 12;
  int ransac_iterations = 100;
  uint64_t seed = 1;
};

struct AbsolutePose {
  Rigid3d camera_from_map;
  std::vector<bool> inliers;  ///< N
  int num_inliers = 0;
};

/// Estimates camera_from_map from 2D-3D matches: EPnP in RANSAC on minimal sets, refitted to all inliers.
/// Model:  pixel_i ~ Project(camera, camera_from_map * X_i)
/// Source: paper Sec. 3.1; Lepetit et al., EPnP, IJCV 2009 (OpenCV's solvePnP). Flat samples, on which EPnP
/// degenerates, go to SQPnP (Terzakis and Lourakis, ECCV 2020).
/// @param landmarks_in_map N, map units. @param pixels_px N, undistorted, same order.
/// @param sigmas_px N, standard deviation of each pixel (its pyramid level's scale); scales max_error_px.
/// Fails with fewer than 4 matches or without min_inliers in agreement. Deterministic for options.seed.
Result<AbsolutePose> EstimateAbsolutePose(const PinholeCamera& camera,
                                          const std::vector<Eigen::Vector3d>& landmarks_in_map,
                                          const std::vector<Eigen::Vector2d>& pixels_px,
                                          const std::vector<double>& sigmas_px, const AbsolutePoseOptions& options);

}  // namespace portolan
