#pragma once

#include <Eigen/Core>
#include <vector>

#include "geometry/camera_model.h"
#include "geometry/rigid3.h"
#include "optimization/bundle_adjustment.h"

namespace portolan {

/// A posed camera, as many points' measurements need it.
struct PointView {
  PointView(const Rigid3d& camera_from_map, const PinholeCamera& posed_camera)
      : rotation(camera_from_map.rotation.toRotationMatrix()),
        translation(camera_from_map.translation),
        camera(posed_camera) {}
  Eigen::Matrix3d rotation;  ///< of camera_from_map
  Eigen::Vector3d translation;
  PinholeCamera camera;
};

/// A landmark seen from a view.
struct PointSighting {
  const PointView* view = nullptr;
  Eigen::Vector2d pixel_px = Eigen::Vector2d::Zero();
  double sigma_px = 1.0;
};

struct PointOptimizationOptions {
  int iterations = 5;                          ///< at most; a point near its place needs 2 or 3
  double loss_width = kReprojectionLossWidth;  ///< of Cauchy's loss, sigmas
};

/// Robust loss of a point (half sum of squares under Cauchy's loss); sightings behind their camera count as gross
/// errors.
double PointLoss(const std::vector<PointSighting>& sightings, const Eigen::Vector3d& point_in_map, double loss_width);

/// Minimises it over the point with the poses held: Levenberg-Marquardt. @return a point that is no worse than the
/// initial one; that itself with fewer than two sightings. Deterministic.
Eigen::Vector3d OptimizePoint(const std::vector<PointSighting>& sightings, const Eigen::Vector3d& initial_in_map,
                              const PointOptimizationOptions& options = {});

}  // namespace portolan
