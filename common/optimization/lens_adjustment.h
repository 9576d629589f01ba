#pragma once

#include <optional>

#include "geometry/camera_model.h"
#include "optimization/bundle_adjustment.h"

namespace portolan {

/// What bundle adjustment with a free lens found.
struct LensAdjustment {
  RadialResidual residual;
  double cost_without = 0;  ///< robust, half sum of squares in sigmas^2, without a residual; both at their minimum
  double cost_with = 0;
  /// With a free focal length in place of the residual: where that explains more, the residual only stands for it.
  double cost_focal = 0;
};

/// Bundle adjustment (poses, points) with the radial distortion that the calibration left as two more unknowns, common
/// to all poses: a wrong distortion bends the paths of features, which a trajectory with turns makes up for by a scale
/// that drifts. One camera took all the pictures.
/// @param problem poses and points to start from, at least one pose fixed, each point measured at least twice; not
/// changed. @return none for an empty problem, or if the solver failed. A check fails for more than one camera.
/// @param known what is known of the residual already, where it starts and what "without" then stands for; measurements
/// still have it in them.
std::optional<LensAdjustment> AdjustLens(const BundleProblem& problem, const BundleOptions& options,
                                         const RadialResidual& known = {});

}  // namespace portolan
