#pragma once

#include <Eigen/Core>
#include <atomic>
#include <cstdint>
#include <vector>

#include "geometry/camera_model.h"
#include "geometry/rigid3.h"

namespace portolan {

/// A bundle adjustment problem over its own copies of poses and points; indices refer to the vectors here.
struct BundleProblem {
  struct Pose {
    Rigid3d camera_from_map;
    PinholeCamera camera;
    bool fixed = false;
  };
  struct Measurement {
    uint32_t pose = 0;
    uint32_t point = 0;
    Eigen::Vector2d pixel_px = Eigen::Vector2d::Zero();
    double sigma_px = 1.0;
  };
  std::vector<Pose> poses;
  std::vector<Eigen::Vector3d> points_in_map;
  std::vector<Measurement> measurements;
};

/// Width of Cauchy's loss, in sigmas of a feature. A corner that was matched rightly lies within about a third of a
/// pixel of its level (0.33 to 0.35 measured on rendered and real streets); what lies further is more and more often
/// something else: the crossing of two edges at different depths, or the next stone of a pavement. Such errors are not
/// symmetric. With Huber's loss at 2.45 sigmas they shrank a street of cobbles by a third over 560 frames, with this
/// one by a tenth.
inline constexpr double kReprojectionLossWidth = 0.3;

struct BundleOptions {
  int max_iterations = 10;
  bool robust = true;                          ///< Cauchy's loss; off: least squares
  double loss_width = kReprojectionLossWidth;  ///< sigmas
  int num_threads = 1;
  double function_tolerance = 1e-4;
};

struct BundleSummary {
  bool converged_or_stopped = false;  ///< false: nothing usable came out and the problem is unchanged
  bool interrupted = false;           ///< stopped by `stop`; the problem holds the best state so far
  int iterations = 0;
  double initial_cost = 0, final_cost = 0;  ///< robust, half sum of squares
};

/// Minimises the reprojection error over poses and points in place, with Ceres (Schur complement on the points). At
/// least one pose must be fixed; a problem with a single fixed pose leaves the scale to the caller (fix two, as map
/// initialisation does). `stop` may be null; once true the solver returns after the current iteration.
BundleSummary AdjustBundle(BundleProblem* problem, const BundleOptions& options, const std::atomic<bool>* stop);

/// A check fails unless one pose is fixed and all indices are within their lists.
void CheckBundle(const BundleProblem& problem);
/// Whether there are measurements, and all values are finite, sigmas positive.
bool IsUsableBundle(const BundleProblem& problem);

/// Normalised squared reprojection error of a measurement; infinity behind the camera.
double NormalizedSquaredError(const BundleProblem& problem, const BundleProblem::Measurement& measurement);

}  // namespace portolan
