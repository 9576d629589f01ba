#include "map_optimization/keyframe_adjustment.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <unordered_set>
#include <utility>

#include "map_optimization/depth_ratio.h"
#include "map_optimization/map_correction.h"
#include "map_optimization/reprojection_error.h"
#include "map_optimization/window_problem.h"
#include "optimization/large_bundle.h"

namespace portolan {
namespace {

constexpr int kMinLandmarks = 15;    // of a keyframe that takes part: fewer don't hold it
constexpr size_t kMinKeyFrames = 3;  // below there is nothing that local BA has not done

using Counts = std::unordered_map<KeyFrameId, int>;

/// Landmarks with the number of keyframes in `counts` that see them, longest tracks first, then by id.
std::vector<std::pair<MapPointId, int>> CollectTracks(const Map& map, const Counts& counts) {
  std::vector<std::pair<MapPointId, int>> tracks;
  for (const auto& [id, point] : map.points()) {
    int length = 0;
    for (const Observation& o : point.observations) length += static_cast<int>(counts.count(o.keyframe));
    if (length >= 2) tracks.emplace_back(id, length);
  }
  std::sort(tracks.begin(), tracks.end(), [](const auto& a, const auto& b) {
    return a.second != b.second ? a.second > b.second : a.first < b.first;
  });
  return tracks;
}

/// Leaves out keyframes that the points don't hold, and points that those leave without two observers.
BundleWindow MakeWindow(const Map& map, const std::vector<KeyFrameId>& keyframes, std::vector<MapPointId> points) {
  Counts counts;
  for (const MapPointId id : points) {
    for (const Observation& o : map.point(id).observations) ++counts[o.keyframe];
  }
  BundleWindow window;
  for (const KeyFrameId id : keyframes) {
    if (counts[id] < kMinLandmarks) continue;
    (window.fixed.empty() ? window.fixed : window.free).push_back(id);
  }
  window.points = std::move(points);
  return window;
}

bool IsRaised(const std::atomic<bool>* stop) {
  return stop != nullptr && stop->load(std::memory_order_relaxed);
}

/// Mean reprojection loss of the map once the correction is applied; "interrupted".
Result<double> LossAfter(const MapCorrection& correction, const Map& map, const std::atomic<bool>* stop) {
  if (IsRaised(stop)) return Error{"interrupted"};
  Map corrected = map;
  if (IsRaised(stop)) return Error{"interrupted"};
  const auto applied = ApplyMapCorrection(correction, &corrected);
  if (IsRaised(stop)) return Error{"interrupted"};
  return applied.ok() ? MeanReprojectionLoss(corrected) : std::numeric_limits<double>::infinity();
}

}  // namespace

std::vector<MapPointId> SelectLandmarks(const Map& map, const std::vector<KeyFrameId>& keyframes, int per_keyframe) {
  Counts counts;
  for (const KeyFrameId id : keyframes) counts.emplace(id, 0);
  std::vector<MapPointId> selected;
  for (const auto& [id, length] : CollectTracks(map, counts)) {
    int lacking = 0;
    for (const Observation& o : map.point(id).observations) {
      const auto found = counts.find(o.keyframe);
      lacking += found != counts.end() && found->second < per_keyframe ? 1 : 0;
    }
    if (lacking < 2) continue;
    selected.push_back(id);
    for (const Observation& o : map.point(id).observations) {
      if (const auto found = counts.find(o.keyframe); found != counts.end()) ++found->second;
    }
  }
  return selected;
}

Result<AdjustedKeyFrames> AdjustKeyFrames(const Map& map, const std::vector<KeyFrameId>& keyframes,
                                          const KeyFrameAdjustmentOptions& options, const std::atomic<bool>* stop) {
  const BundleWindow window =
      MakeWindow(map, keyframes, SelectLandmarks(map, keyframes, options.landmarks_per_keyframe));
  if (window.free.size() + window.fixed.size() < kMinKeyFrames) {
    return Error{std::to_string(window.free.size() + window.fixed.size()) + " of " + std::to_string(keyframes.size()) +
                 " keyframes share enough landmarks, expected at least " + std::to_string(kMinKeyFrames)};
  }
  WindowProblem problem = MakeWindowProblem(map, window);
  BundleOptions bundle;
  bundle.max_iterations = options.max_iterations;
  bundle.function_tolerance = options.function_tolerance;
  AdjustedKeyFrames result;
  result.measurements = static_cast<int>(problem.problem.measurements.size());
  result.summary = AdjustLargeBundle(&problem.problem, bundle, stop);
  if (result.summary.interrupted) return Error{"interrupted"};
  if (!result.summary.converged_or_stopped) return Error{"the BA failed"};

  Map solved = map;
  TakeSolution(window, problem, &solved);
  for (const MapPointId id : problem.points) result.points.push_back({id, solved.point(id).position_in_map});
  const std::unordered_set<MapPointId> points(problem.points.begin(), problem.points.end());
  for (const auto* ids : {&window.fixed, &window.free}) {
    for (const KeyFrameId id : *ids) {
      const Rigid3d& pose = solved.keyframe(id).camera_from_map;
      const double scale = DepthRatio(map, solved, id, points, 1.0);
      result.camera_from_map.emplace(id, Sim3d(scale, pose.rotation, scale * pose.translation));
    }
  }
  return result;
}

void KeepFrame(const Map& map, MapCorrection* correction) {
  const auto is_root = [&](const auto& keyframe) { return !map.keyframe(keyframe.id).parent.IsValid(); };
  const auto root = std::find_if(correction->keyframes.begin(), correction->keyframes.end(), is_root);
  if (root == correction->keyframes.end()) return;
  const Rigid3d old_root = map.keyframe(root->id).camera_from_map, new_root = MakeRigid(root->camera_from_map);
  double old_sum = 0, new_sum = 0;
  for (const auto& keyframe : correction->keyframes) {
    const Eigen::Vector3d centre = keyframe.camera_from_map.Inverse().translation;
    old_sum += (old_root * map.keyframe(keyframe.id).camera_from_map.TargetOriginInSource()).squaredNorm();
    new_sum += (new_root * centre).squaredNorm();
  }
  const double scale = new_sum > 0 && old_sum > 0 ? std::sqrt(old_sum / new_sum) : 1.0;
  const Sim3d kept_from_new =
      Sim3d(old_root.Inverse()) * Sim3d(scale, Eigen::Quaterniond::Identity(), {0, 0, 0}) * Sim3d(new_root);
  const Sim3d new_from_kept = kept_from_new.Inverse();
  for (auto& keyframe : correction->keyframes) keyframe.camera_from_map = keyframe.camera_from_map * new_from_kept;
  for (auto& point : correction->points) {
    point.position_in_map = (kept_from_new * point.position_in_map.cast<double>()).cast<float>();
  }
}

Status CompleteCorrection(const Map& map, const std::unordered_set<KeyFrameId>& held, const FollowerOptions& options,
                          const std::atomic<bool>* stop, MapCorrection* correction, std::optional<LossChange>* losses) {
  MapCorrection reference = EmptyCorrection(map, correction->kind);
  for (const auto& keyframe : correction->keyframes) {
    reference.keyframes.push_back({keyframe.id, Sim3d(map.keyframe(keyframe.id).camera_from_map)});
  }
  if (Status refined = RefineFollowers(map, held, options, stop, correction); !refined.ok()) return refined;
  if (Status refined = RefineFollowers(map, held, options, stop, &reference); !refined.ok()) return refined;
  KeepFrame(map, correction);
  const auto without = LossAfter(reference, map, stop);
  if (!without.ok()) return without.error();
  const auto with = LossAfter(*correction, map, stop);
  if (!with.ok()) return with.error();
  if (losses != nullptr) *losses = LossChange{*without, *with};
  if (*with < *without) return Ok{};
  return Error{"the mean reprojection loss would be " + std::to_string(*with) + ", without it " +
               std::to_string(*without)};
}

}  // namespace portolan
