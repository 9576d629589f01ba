#include "map_optimization/follower_refinement.h"

#include <unordered_map>
#include <utility>
#include <vector>

#include "geometry/sim3.h"
#include "map_optimization/map_correction.h"
#include "optimization/point_optimization.h"
#include "optimization/pose_optimization.h"

namespace portolan {
namespace {

bool IsRaised(const std::atomic<bool>* stop) {
  return stop != nullptr && stop->load(std::memory_order_relaxed);
}

/// Starts are near: no need to look for inliers again and again.
PoseOptimizationOptions NearStart() {
  PoseOptimizationOptions options;
  options.rounds = 1;
  options.iterations = 4;
  return options;
}

/// Poses and positions of a map, being refined.
class Refinement {
 public:
  /// @param map must outlive it.
  explicit Refinement(const Map& map) : map_(map), ids_(map.SortedPointIds()) {
    for (const auto& [id, keyframe] : map.keyframes()) {
      keyframes_.emplace(id, Placed{keyframe.camera_from_map,
                                    {keyframe.camera_from_map, keyframe.data->camera},
                                    keyframe.data->pyramid.Sigmas()});
    }
    for (const MapPointId id : ids_) positions_.emplace(id, map.point(id).position_in_map.cast<double>());
  }

  void RefineKeyFrame(KeyFrameId id, int min_landmarks) {
    const KeyFrame& keyframe = map_.keyframe(id);
    Placed& placed = keyframes_.at(id);
    const FeatureSet& features = keyframe.data->features;
    PoseMatches matches;
    const std::vector<MapPointId> landmarks = keyframe.landmarks.ByFeature();
    for (size_t feature = 0; feature < landmarks.size(); ++feature) {
      if (!landmarks[feature].IsValid()) continue;
      matches.landmarks_in_map.push_back(positions_.at(landmarks[feature]));
      matches.pixels_px.push_back(features.pixels_px[feature].cast<double>());
      matches.sigmas_px.push_back(placed.sigmas[features.octaves[feature]]);
    }
    const PoseOptimizationResult refined =
        OptimizePose(keyframe.data->camera, matches, placed.camera_from_map, NearStart());
    if (refined.num_inliers < min_landmarks) return;
    placed.camera_from_map = refined.camera_from_map;
    placed.view = PointView(refined.camera_from_map, keyframe.data->camera);
  }

  void RefinePoint(MapPointId id) {
    sightings_.clear();
    for (const Observation& o : map_.point(id).observations) {
      const Placed& placed = keyframes_.at(o.keyframe);
      const FeatureSet& features = map_.keyframe(o.keyframe).data->features;
      sightings_.push_back(
          {&placed.view, features.pixels_px[o.feature].cast<double>(), placed.sigmas[features.octaves[o.feature]]});
    }
    Eigen::Vector3d& position = positions_.at(id);
    position = OptimizePoint(sightings_, position);
  }

  const std::vector<MapPointId>& point_ids() const { return ids_; }
  const Rigid3d& camera_from_map(KeyFrameId id) const { return keyframes_.at(id).camera_from_map; }
  Eigen::Vector3f position(MapPointId id) const { return positions_.at(id).cast<float>(); }

 private:
  struct Placed {
    Rigid3d camera_from_map;
    PointView view;
    std::vector<double> sigmas;
  };
  const Map& map_;
  std::vector<MapPointId> ids_;
  std::unordered_map<KeyFrameId, Placed> keyframes_;
  std::unordered_map<MapPointId, Eigen::Vector3d> positions_;
  std::vector<PointSighting> sightings_;
};

}  // namespace

Status RefineFollowers(const Map& map, const std::unordered_set<KeyFrameId>& held, const FollowerOptions& options,
                       const std::atomic<bool>* stop, MapCorrection* correction) {
  Map corrected = map;
  if (const auto applied = ApplyMapCorrection(*correction, &corrected); !applied.ok()) return applied.error();
  Refinement refinement(corrected);
  for (int round = 0; round < options.rounds; ++round) {
    for (const auto& keyframe : correction->keyframes) {
      if (IsRaised(stop)) return Error{"interrupted"};
      if (held.count(keyframe.id) == 0) refinement.RefineKeyFrame(keyframe.id, options.min_landmarks);
    }
    for (const MapPointId id : refinement.point_ids()) {
      if (IsRaised(stop)) return Error{"interrupted"};
      refinement.RefinePoint(id);
    }
  }
  if (IsRaised(stop)) return Error{"interrupted"};
  for (auto& keyframe : correction->keyframes) {
    const double scale = keyframe.camera_from_map.scale;
    const Rigid3d& pose = refinement.camera_from_map(keyframe.id);
    keyframe.camera_from_map = Sim3d(scale, pose.rotation, scale * pose.translation);
  }
  correction->points.clear();
  for (const MapPointId id : refinement.point_ids()) {
    const Eigen::Vector3f position = refinement.position(id);
    if (position.allFinite() && position != map.point(id).position_in_map) correction->points.push_back({id, position});
  }
  return Ok{};
}

}  // namespace portolan
