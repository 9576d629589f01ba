#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "base/result.h"
#include "base/time.h"
#include "dataset/trajectory_io.h"
#include "geometry/sim3.h"

namespace portolan {

struct EvaluationOptions {
  /// Seconds between an estimate and its ground truth; 0: half the median interval of the ground truth.
  double max_dt = 0;
  bool fix_scale = false;         ///< align rigidly: for estimates in metres
  double rpe_delta = 1;           ///< of the relative pose error, in seconds
  std::optional<int> rpe_frames;  ///< or so many poses of the ground truth in place of rpe_delta
  std::optional<Timestamp> from;  ///< poses before it are left out
  std::optional<Timestamp> to;    ///< and after it
  std::vector<Timestamp> frames;  ///< of the camera, for the coverage; empty: the poses of the ground truth
  size_t num_frames = 0;          ///< of the camera in the span, if only their number is known
};

/// Of a set of errors; all 0 if there are none.
struct ErrorStatistics {
  size_t count = 0;
  double rmse = 0, mean = 0, median = 0, std = 0, max = 0;
};

/// An estimated pose and the ground truth at its time, by their numbers in the two trajectories.
struct PosePair {
  size_t truth = 0;
  size_t estimate = 0;
};

/// One map (or all as one) after its alignment to the ground truth.
struct AlignedMap {
  int map = 0;
  Trajectory estimate;                  ///< its poses in the span, as they were
  std::vector<PosePair> pairs;          ///< numbers in `Evaluation::truth` and in `estimate`
  std::optional<Sim3d> truth_from_map;  ///< none when it could not be aligned: why is in `failure`
  std::string failure;
  ErrorStatistics ate;  ///< absolute trajectory error: |truth - aligned estimate|, units of the ground truth
};

struct Evaluation {
  Trajectory truth;               ///< in the span
  double max_dt = 0;              ///< seconds, as used
  size_t num_frames = 0;          ///< of the camera, in the span
  size_t num_tracked = 0;         ///< of them with an estimated pose
  AlignedMap joined;              ///< all poses as one trajectory
  std::vector<AlignedMap> maps;   ///< each map by itself, by number
  ErrorStatistics maps_combined;  ///< over the errors of all maps that could be aligned by themselves
  ErrorStatistics
      rpe_translation;  ///< relative pose error within maps, each at its own scale: units of the ground truth
  ErrorStatistics rpe_rotation_deg;
  /// Share of the camera's frames that have an estimated pose.
  double Coverage() const {
    return num_frames == 0 ? 0 : static_cast<double>(num_tracked) / static_cast<double>(num_frames);
  }
};

ErrorStatistics Summarize(const std::vector<double>& errors);

/// Pairs of nearest times, at most max_dt seconds apart; every pose is in one pair at most. Both trajectories in the
/// order of time.
std::vector<PosePair> AssociateByTime(const Trajectory& truth, const Trajectory& estimate, double max_dt);

/// The poses nearest to the camera's frames, at most max_dt seconds away: makes a ground truth of a higher rate one
/// pose a frame.
Trajectory SelectFrames(const Trajectory& truth, const std::vector<Timestamp>& frames, double max_dt);

/// Half the median interval of a trajectory, and a microsecond for times rounded in files. Seconds; 0 for fewer than
/// two poses.
double HalfMedianInterval(const Trajectory& trajectory);

/// Compares an estimate with the ground truth after Sim3 alignment (Umeyama; geometry/sim3_alignment.h).
/// ATE and RPE as in Sturm et al., A benchmark for the evaluation of RGB-D SLAM systems, IROS 2012.
/// Fails when no estimated pose is near a ground truth pose in time. A map with too few or collinear poses is no
/// failure: it says so in `failure`.
Result<Evaluation> EvaluateTrajectory(const Trajectory& truth, const Trajectory& estimate,
                                      const EvaluationOptions& options);

}  // namespace portolan
