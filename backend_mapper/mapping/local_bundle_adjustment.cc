#include "mapping/local_bundle_adjustment.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <unordered_map>
#include <unordered_set>
#include <utility>

namespace portolan {
namespace {

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
void FixGauge(const Map& map, BundleWindow* window) {
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

}  // namespace

BundleWindow SelectLocalWindow(const Map& map, KeyFrameId keyframe, const LocalBundleOptions& options) {
  BundleWindow window;
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
  const BundleWindow window = SelectLocalWindow(*map, keyframe, options);
  if (window.free.empty() || window.fixed.empty()) return result;
  WindowProblem window_problem = MakeWindowProblem(*map, window);
  result.keyframes = static_cast<int>(window.free.size());
  result.points = static_cast<int>(window_problem.points.size());
  result.measurements = static_cast<int>(window_problem.problem.measurements.size());
  BundleOptions bundle;
  bundle.max_iterations = options.iterations;
  result.summary = AdjustBundle(&window_problem.problem, bundle, stop);
  if (!result.summary.converged_or_stopped) return result;
  TakeSolution(window, window_problem, map);
  if (!result.summary.interrupted || result.summary.iterations >= kMinSettledIterations) {
    result.outliers = RemoveOutliers(window_problem, options.chi2, map);
  }
  map->RefreshDerived();
  return result;
}

}  // namespace portolan
