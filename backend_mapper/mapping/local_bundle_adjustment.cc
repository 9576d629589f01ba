#include "mapping/local_bundle_adjustment.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <unordered_map>
#include <unordered_set>
#include <utility>

namespace portolan {
namespace {

// A change below these is not put into the map, so that deltas stay small. As an angle seen from a camera both are
// under a tenth of a pixel at a focal length of 1000, a tenth of a feature's standard deviation.
constexpr double kNoticeablePointShift = 1e-4;  // of the point's distance from a camera that sees it
constexpr double kNoticeablePoseShift = 1e-5;   // radians, and of the median depth

// An interrupted solution is good enough to tell outliers by after so many iterations: most cost falls in the first
// two.
constexpr int kMinSettledIterations = 2;

// Keyframes that pin the window: one fixes the frame (six freedoms), a second the scale.
constexpr size_t kMinFixed = 2;

/// Keyframes outside `inside` that see the points, by number of points seen, most first, then by id.
std::vector<KeyFrameId> SelectObservers(const Map& map, const std::vector<MapPointId>& points,
                                        const std::unordered_set<KeyFrameId>& inside, size_t most) {
  std::map<KeyFrameId, int> seen;
  for (const MapPointId id : points) {
    for (const Observation& o : map.point(id).observations) {
      if (inside.count(o.keyframe) == 0) ++seen[o.keyframe];
    }
  }
  std::vector<std::pair<KeyFrameId, int>> observers(seen.begin(), seen.end());
  std::stable_sort(observers.begin(), observers.end(),
                   [](const auto& a, const auto& b) { return a.second > b.second; });
  if (observers.size() > most) observers.resize(most);
  std::vector<KeyFrameId> ids;
  for (const auto& [id, count] : observers) ids.push_back(id);
  return ids;
}

/// Moves the free keyframes that must not move to the fixed ones.
void FixGauge(const Map& map, LocalWindow* window) {
  std::vector<KeyFrameId> oldest_first = window->free;
  std::sort(oldest_first.begin(), oldest_first.end());
  std::stable_partition(oldest_first.begin(), oldest_first.end(),
                        [&](KeyFrameId id) { return !map.keyframe(id).parent.IsValid(); });
  for (const KeyFrameId id : oldest_first) {
    const bool is_root = !map.keyframe(id).parent.IsValid();
    if (!is_root && (window->fixed.size() >= kMinFixed || window->free.size() == 1)) continue;
    window->free.erase(std::find(window->free.begin(), window->free.end(), id));
    window->fixed.push_back(id);
  }
}

/// A window as a problem. Poses are the window's free keyframes, then its fixed ones.
struct WindowProblem {
  BundleProblem problem;
  std::vector<MapPointId> points;                          // of the problem's points
  std::vector<std::pair<MapPointId, KeyFrameId>> sources;  // of the measurements
};

/// Keyframes of a window by their index in the problem.
struct PoseTable {
  std::unordered_map<KeyFrameId, uint32_t> index;
  std::vector<const KeyFrameData*> data;
  std::vector<std::vector<double>> scales;
};

PoseTable AddPoses(const Map& map, const LocalWindow& window, BundleProblem* problem) {
  PoseTable table;
  for (const bool fixed : {false, true}) {
    for (const KeyFrameId id : fixed ? window.fixed : window.free) {
      const KeyFrame& keyframe = map.keyframe(id);
      table.index.emplace(id, static_cast<uint32_t>(table.data.size()));
      table.data.push_back(keyframe.data.get());
      table.scales.push_back(keyframe.data->pyramid.Sigmas());
      problem->poses.push_back({keyframe.camera_from_map, keyframe.data->camera, fixed});
    }
  }
  return table;
}

WindowProblem MakeProblem(const Map& map, const LocalWindow& window) {
  WindowProblem result;
  const PoseTable poses = AddPoses(map, window, &result.problem);
  auto& measurements = result.problem.measurements;
  for (const MapPointId id : window.points) {
    const MapPoint& point = map.point(id);
    const size_t before = measurements.size();
    for (const Observation& o : point.observations) {
      const auto found = poses.index.find(o.keyframe);
      if (found == poses.index.end()) continue;
      const FeatureSet& features = poses.data[found->second]->features;
      measurements.push_back({found->second, static_cast<uint32_t>(result.points.size()),
                              features.pixels_px[o.feature].cast<double>(),
                              poses.scales[found->second][features.octaves[o.feature]]});
      result.sources.emplace_back(id, o.keyframe);
    }
    if (measurements.size() < before + 2) {  // its other observers were cut: nothing would hold its depth
      measurements.resize(before);
      result.sources.resize(before);
      continue;
    }
    result.points.push_back(id);
    result.problem.points_in_map.push_back(point.position_in_map.cast<double>());
  }
  return result;
}

bool IsNoticeable(const Rigid3d& before, const Rigid3d& after, double median_depth) {
  const Rigid3d change = after * before.Inverse();
  return LogSO3(change.rotation).norm() > kNoticeablePoseShift ||
         change.translation.norm() > kNoticeablePoseShift * median_depth;
}

/// Removes observations with gross errors at the solution, and points that they leave without two.
int RemoveOutliers(Map* map, const WindowProblem& window_problem, double chi2) {
  int removed = 0;
  for (size_t k = 0; k < window_problem.sources.size(); ++k) {
    if (NormalizedSquaredError(window_problem.problem, window_problem.problem.measurements[k]) <= chi2) continue;
    const auto& [point, keyframe] = window_problem.sources[k];
    if (map->FindPoint(point) == nullptr) continue;
    map->RemoveObservation(point, keyframe);
    ++removed;
    if (map->point(point).observations.size() < 2) map->RemovePoint(point);
  }
  return removed;
}

void TakePoses(Map* map, const LocalWindow& window, const BundleProblem& problem) {
  for (size_t k = 0; k < window.free.size(); ++k) {
    const Rigid3d& after = problem.poses[k].camera_from_map;
    const Rigid3d before = map->keyframe(window.free[k]).camera_from_map;
    if (IsNoticeable(before, after, map->MedianDepth(window.free[k]))) map->SetPose(window.free[k], after);
  }
}

void TakePositions(Map* map, const WindowProblem& solved) {
  std::vector<double> distances(solved.points.size());
  for (const auto& measurement : solved.problem.measurements) {
    const Rigid3d& camera_from_map = solved.problem.poses[measurement.pose].camera_from_map;
    distances[measurement.point] = (camera_from_map * solved.problem.points_in_map[measurement.point]).norm();
  }
  for (size_t k = 0; k < solved.points.size(); ++k) {
    const Eigen::Vector3f after = solved.problem.points_in_map[k].cast<float>();
    if (!after.allFinite()) continue;
    const double shift = static_cast<double>((after - map->point(solved.points[k]).position_in_map).norm());
    if (shift > kNoticeablePointShift * distances[k]) map->SetPosition(solved.points[k], after);
  }
}

}  // namespace

LocalWindow SelectLocalWindow(const Map& map, KeyFrameId keyframe, const LocalBundleOptions& options) {
  LocalWindow window;
  window.free.push_back(keyframe);
  for (const auto& [id, common] :
       map.CovisibleKeyFrames(keyframe, options.min_common, static_cast<size_t>(options.max_keyframes - 1))) {
    window.free.push_back(id);
  }
  std::unordered_set<MapPointId> seen;
  for (const KeyFrameId id : window.free) {
    for (const MapPointId landmark : map.keyframe(id).landmarks) {
      if (seen.insert(landmark).second) window.points.push_back(landmark);
    }
  }
  const std::unordered_set<KeyFrameId> inside(window.free.begin(), window.free.end());
  window.fixed = SelectObservers(map, window.points, inside, static_cast<size_t>(options.max_fixed));
  FixGauge(map, &window);
  return window;
}

LocalBundleResult OptimizeLocalWindow(Map* map, KeyFrameId keyframe, const LocalBundleOptions& options,
                                      const std::atomic<bool>* stop) {
  LocalBundleResult result;
  const LocalWindow window = SelectLocalWindow(*map, keyframe, options);
  if (window.free.empty() || window.fixed.empty()) return result;
  WindowProblem window_problem = MakeProblem(*map, window);
  result.keyframes = static_cast<int>(window.free.size());
  result.points = static_cast<int>(window_problem.points.size());
  result.measurements = static_cast<int>(window_problem.problem.measurements.size());
  BundleOptions bundle;
  bundle.max_iterations = options.iterations;
  result.summary = AdjustBundle(&window_problem.problem, bundle, stop);
  if (!result.summary.converged_or_stopped) return result;
  TakePoses(map, window, window_problem.problem);
  TakePositions(map, window_problem);
  if (!result.summary.interrupted || result.summary.iterations >= kMinSettledIterations) {
    result.outliers = RemoveOutliers(map, window_problem, options.chi2);
  }
  map->RefreshDerived();
  return result;
}

}  // namespace portolan
