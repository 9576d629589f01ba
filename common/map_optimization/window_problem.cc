#include "map_optimization/window_problem.h"

#include <unordered_map>

namespace portolan {
namespace {

// A change below these is not put into the map, so that deltas stay small. As an angle seen from a camera both are
// under a tenth of a pixel at a focal length of 1000, a tenth of a feature's standard deviation.
constexpr double kNoticeablePointShift = 1e-4;  // of the point's distance from a camera that sees it
constexpr double kNoticeablePoseShift = 1e-5;   // radians, and of the median depth

/// Keyframes of a window by their index in the problem.
struct PoseTable {
  std::unordered_map<KeyFrameId, uint32_t> index;
  std::vector<const KeyFrameData*> data;
  std::vector<std::vector<double>> scales;
};

PoseTable AddPoses(const Map& map, const BundleWindow& window, BundleProblem* problem) {
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

bool IsNoticeable(const Rigid3d& before, const Rigid3d& after, double median_depth) {
  const Rigid3d change = after * before.Inverse();
  return LogSO3(change.rotation).norm() > kNoticeablePoseShift ||
         change.translation.norm() > kNoticeablePoseShift * median_depth;
}

void TakePoses(const BundleWindow& window, const BundleProblem& problem, Map* map) {
  for (size_t k = 0; k < window.free.size(); ++k) {
    const Rigid3d& after = problem.poses[k].camera_from_map;
    const Rigid3d before = map->keyframe(window.free[k]).camera_from_map;
    if (IsNoticeable(before, after, map->MedianDepth(window.free[k]))) map->SetPose(window.free[k], after);
  }
}

void TakePositions(const WindowProblem& solved, Map* map) {
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

WindowProblem MakeWindowProblem(const Map& map, const BundleWindow& window) {
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

void TakeSolution(const BundleWindow& window, const WindowProblem& solved, Map* map) {
  TakePoses(window, solved.problem, map);
  TakePositions(solved, map);
}

int RemoveOutliers(const WindowProblem& solved, double chi2, Map* map) {
  int removed = 0;
  for (size_t k = 0; k < solved.sources.size(); ++k) {
    if (NormalizedSquaredError(solved.problem, solved.problem.measurements[k]) <= chi2) continue;
    const auto& [point, keyframe] = solved.sources[k];
    if (map->FindPoint(point) == nullptr) continue;
    map->RemoveObservation(point, keyframe);
    ++removed;
    if (map->point(point).observations.size() < 2) map->RemovePoint(point);
  }
  return removed;
}

}  // namespace portolan
