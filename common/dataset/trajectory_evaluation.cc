#include "dataset/trajectory_evaluation.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <set>

#include "base/statistics.h"
#include "dataset/text_table.h"
#include "geometry/rigid3.h"
#include "geometry/sim3_alignment.h"

namespace portolan {
namespace {

/// Files round times to a microsecond.
constexpr double kFileRounding = 1e-6;

bool IsWithin(Timestamp stamp, const EvaluationOptions& options) {
  return !(options.from && stamp < *options.from) && !(options.to && *options.to < stamp);
}

Trajectory SortedSpan(const Trajectory& trajectory, const EvaluationOptions& options) {
  Trajectory span;
  for (const TrajectoryPose& pose : trajectory) {
    if (IsWithin(pose.stamp, options)) span.push_back(pose);
  }
  std::stable_sort(span.begin(), span.end(), [](const auto& a, const auto& b) { return a.stamp < b.stamp; });
  return span;
}

/// Number of the pose nearest to a time; the trajectory is not empty.
size_t NearestPose(const Trajectory& trajectory, Timestamp stamp) {
  const auto after = std::lower_bound(trajectory.begin(), trajectory.end(), stamp,
                                      [](const TrajectoryPose& pose, Timestamp time) { return pose.stamp < time; });
  if (after == trajectory.begin()) return 0;
  const size_t upper = static_cast<size_t>(after - trajectory.begin());
  if (after == trajectory.end()) return upper - 1;
  return stamp.ns - trajectory[upper - 1].stamp.ns <= after->stamp.ns - stamp.ns ? upper - 1 : upper;
}

double AbsSecondsBetween(Timestamp a, Timestamp b) {
  return std::abs(SecondsBetween(a, b));
}

/// Aligns one map and fills in its errors, also returned.
std::vector<double> Align(const Trajectory& truth, const EvaluationOptions& options, double max_dt, AlignedMap* map) {
  map->pairs = AssociateByTime(truth, map->estimate, max_dt);
  std::vector<Eigen::Vector3d> estimated;
  std::vector<Eigen::Vector3d> true_points;
  for (const PosePair& pair : map->pairs) {
    estimated.push_back(map->estimate[pair.estimate].world_from_camera.translation);
    true_points.push_back(truth[pair.truth].world_from_camera.translation);
  }
  const Result<Sim3d> aligned = AlignPoints(estimated, true_points, options.fix_scale);
  if (!aligned) {
    map->failure = aligned.error().message;
    return {};
  }
  map->truth_from_map = *aligned;
  std::vector<double> errors;
  for (size_t i = 0; i < estimated.size(); ++i) errors.push_back((true_points[i] - *aligned * estimated[i]).norm());
  map->ate = Summarize(errors);
  return errors;
}

/// The pair that comes `delta` after pair i; none if tracking had a gap there.
std::optional<PosePair> PairAfter(const Trajectory& truth, const AlignedMap& map, size_t i,
                                  const EvaluationOptions& options, double max_dt) {
  const PosePair& first = map.pairs[i];
  if (options.rpe_frames) {
    const size_t wanted = first.truth + static_cast<size_t>(*options.rpe_frames);
    for (size_t j = i + 1; j < map.pairs.size() && map.pairs[j].truth <= wanted; ++j) {
      if (map.pairs[j].truth == wanted) return map.pairs[j];
    }
    return std::nullopt;
  }
  const Timestamp target{truth[first.truth].stamp.ns + Timestamp::FromSeconds(options.rpe_delta).ns};
  std::optional<PosePair> best;
  double best_dt = max_dt;
  for (size_t j = i + 1; j < map.pairs.size(); ++j) {
    const Timestamp stamp = truth[map.pairs[j].truth].stamp;
    if (SecondsBetween(target, stamp) > max_dt) break;
    const double dt = AbsSecondsBetween(stamp, target);
    if (dt > best_dt) continue;
    best_dt = dt;
    best = map.pairs[j];
  }
  return best;
}

void AddRelativeErrors(const Trajectory& truth, const AlignedMap& map, const EvaluationOptions& options, double max_dt,
                       std::vector<double>* translations, std::vector<double>* rotations_deg) {
  if (!map.truth_from_map) return;
  for (size_t i = 0; i < map.pairs.size(); ++i) {
    const std::optional<PosePair> later = PairAfter(truth, map, i, options, max_dt);
    if (!later) continue;
    const PosePair& first = map.pairs[i];
    const Rigid3d true_motion = truth[first.truth].world_from_camera.Inverse() * truth[later->truth].world_from_camera;
    Rigid3d motion =
        map.estimate[first.estimate].world_from_camera.Inverse() * map.estimate[later->estimate].world_from_camera;
    motion.translation *= map.truth_from_map->scale;
    const Rigid3d error = true_motion.Inverse() * motion;
    translations->push_back(error.translation.norm());
    rotations_deg->push_back(LogSO3(error.rotation).norm() * 180 / M_PI);
  }
}

void CountFrames(const EvaluationOptions& options, Evaluation* evaluation) {
  std::vector<Timestamp> frames;
  for (const Timestamp frame : options.frames) {
    if (IsWithin(frame, options)) frames.push_back(frame);
  }
  if (frames.empty()) {
    for (const TrajectoryPose& pose : evaluation->truth) frames.push_back(pose.stamp);
  }
  evaluation->num_frames = frames.size();
  evaluation->num_tracked = SelectFrames(evaluation->joined.estimate, frames, evaluation->max_dt).size();
  if (options.num_frames > 0) {
    evaluation->num_frames = options.num_frames;
    evaluation->num_tracked = evaluation->joined.estimate.size();
  }
}

std::string DescribeSpan(const Trajectory& trajectory) {
  if (trajectory.empty()) return "no poses";
  return fmt::format("{} poses from {} s to {} s", trajectory.size(), FormatSeconds(trajectory.front().stamp),
                     FormatSeconds(trajectory.back().stamp));
}

std::vector<AlignedMap> SplitByMap(const Trajectory& estimate) {
  std::map<int, AlignedMap> by_number;
  for (const TrajectoryPose& pose : estimate) {
    AlignedMap& map = by_number[pose.map];
    map.map = pose.map;
    map.estimate.push_back(pose);
  }
  std::vector<AlignedMap> maps;
  for (auto& [number, map] : by_number) maps.push_back(std::move(map));
  return maps;
}

}  // namespace

ErrorStatistics Summarize(const std::vector<double>& errors) {
  ErrorStatistics statistics;
  if (errors.empty()) return statistics;
  double sum = 0;
  double sum_of_squares = 0;
  for (const double error : errors) {
    sum += error;
    sum_of_squares += error * error;
  }
  const double count = static_cast<double>(errors.size());
  statistics.count = errors.size();
  statistics.mean = sum / count;
  statistics.rmse = std::sqrt(sum_of_squares / count);
  double squared_deviations = 0;
  for (const double error : errors) squared_deviations += (error - statistics.mean) * (error - statistics.mean);
  statistics.std = std::sqrt(squared_deviations / count);
  statistics.median = Quantile(errors, 0.5);
  statistics.max = *std::max_element(errors.begin(), errors.end());
  return statistics;
}

std::vector<PosePair> AssociateByTime(const Trajectory& truth, const Trajectory& estimate, double max_dt) {
  if (truth.empty()) return {};
  std::map<size_t, size_t> nearest_estimate;  // of each ground truth pose
  for (size_t i = 0; i < estimate.size(); ++i) {
    const Timestamp stamp = estimate[i].stamp;
    const size_t nearest = NearestPose(truth, stamp);
    const double dt = AbsSecondsBetween(truth[nearest].stamp, stamp);
    if (dt > max_dt) continue;
    const auto [taken, is_new] = nearest_estimate.emplace(nearest, i);
    if (!is_new && dt < AbsSecondsBetween(truth[nearest].stamp, estimate[taken->second].stamp)) taken->second = i;
  }
  std::vector<PosePair> pairs;
  for (const auto& [true_pose, estimated_pose] : nearest_estimate) pairs.push_back({true_pose, estimated_pose});
  return pairs;
}

Trajectory SelectFrames(const Trajectory& truth, const std::vector<Timestamp>& frames, double max_dt) {
  std::set<size_t> chosen;
  for (const Timestamp frame : frames) {
    if (truth.empty()) break;
    const size_t nearest = NearestPose(truth, frame);
    if (AbsSecondsBetween(truth[nearest].stamp, frame) <= max_dt) chosen.insert(nearest);
  }
  Trajectory selected;
  for (const size_t i : chosen) selected.push_back(truth[i]);
  return selected;
}

double HalfMedianInterval(const Trajectory& trajectory) {
  std::vector<double> intervals;
  for (size_t i = 1; i < trajectory.size(); ++i)
    intervals.push_back(SecondsBetween(trajectory[i - 1].stamp, trajectory[i].stamp));
  return intervals.empty() ? 0 : Quantile(intervals, 0.5) / 2 + kFileRounding;
}

Result<Evaluation> EvaluateTrajectory(const Trajectory& truth, const Trajectory& estimate,
                                      const EvaluationOptions& options) {
  Evaluation evaluation;
  evaluation.truth = SortedSpan(truth, options);
  evaluation.max_dt = options.max_dt > 0 ? options.max_dt : HalfMedianInterval(evaluation.truth);
  evaluation.joined.estimate = SortedSpan(estimate, options);
  CountFrames(options, &evaluation);
  evaluation.maps = SplitByMap(evaluation.joined.estimate);
  Align(evaluation.truth, options, evaluation.max_dt, &evaluation.joined);
  if (evaluation.joined.pairs.empty()) {
    return Error{
        fmt::format("no estimated pose within {:.6f} s of a ground truth pose: ground truth has {}, the estimate {}",
                    evaluation.max_dt, DescribeSpan(evaluation.truth), DescribeSpan(evaluation.joined.estimate))};
  }
  std::vector<double> combined;
  std::vector<double> translations;
  std::vector<double> rotations_deg;
  for (AlignedMap& map : evaluation.maps) {
    const std::vector<double> errors = Align(evaluation.truth, options, evaluation.max_dt, &map);
    combined.insert(combined.end(), errors.begin(), errors.end());
    AddRelativeErrors(evaluation.truth, map, options, evaluation.max_dt, &translations, &rotations_deg);
  }
  evaluation.maps_combined = Summarize(combined);
  evaluation.rpe_translation = Summarize(translations);
  evaluation.rpe_rotation_deg = Summarize(rotations_deg);
  return evaluation;
}

}  // namespace portolan
