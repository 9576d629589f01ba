#include "map/map_changes.h"

#include <algorithm>
#include <map>
#include <string>
#include <unordered_set>
#include <utility>

namespace portolan {
namespace {

constexpr size_t kMinObservations = 2;  // of a point: with fewer it is in no snapshot

/// The lists of a snapshot, to be changed.
class State {
 public:
  Status Apply(const MapDelta& delta) {
    for (const auto& removed : delta.removed_points) points_.erase(removed.id);
    RemoveKeyFrames(delta.removed_keyframes);
    for (const auto& state : delta.keyframes) keyframes_[state.id] = state;
    for (const auto& state : delta.points) points_[state.id].position_in_map = state.position_in_map;
    for (const auto& state : delta.observations) {
      if (Status applied = Apply(state); !applied) return applied;
    }
    return Ok{};
  }

  void WriteTo(MapDelta* snapshot) const {
    for (const auto& [id, state] : keyframes_) snapshot->keyframes.push_back(state);
    for (const auto& [id, point] : points_) {
      if (point.observations.size() < kMinObservations) continue;
      snapshot->points.push_back({id, point.position_in_map});
      for (const auto& [keyframe, feature] : point.observations)
        snapshot->observations.push_back({id, keyframe, feature});
    }
  }

 private:
  using Observation = std::pair<KeyFrameId, int32_t>;
  struct Point {
    Eigen::Vector3f position_in_map = Eigen::Vector3f::Zero();
    std::vector<Observation> observations;  // sorted by keyframe
  };

  void RemoveKeyFrames(const std::vector<MapDelta::RemovedKeyFrame>& removed) {
    std::unordered_set<KeyFrameId> ids;
    for (const auto& keyframe : removed) {
      if (keyframes_.erase(keyframe.id) == 1) ids.insert(keyframe.id);
    }
    if (ids.empty()) return;
    for (auto& [id, point] : points_) {
      auto& seen = point.observations;
      const auto is_gone = [&](const Observation& o) { return ids.count(o.first) == 1; };
      seen.erase(std::remove_if(seen.begin(), seen.end(), is_gone), seen.end());
    }
  }

  Status Apply(const MapDelta::ObservationState& state) {
    const auto point = points_.find(state.point);
    if (point == points_.end())
      return Error{"an observation of point " + ToString(state.point) + ", which is not there"};
    auto& seen = point->second.observations;
    const auto at = std::lower_bound(seen.begin(), seen.end(), state.keyframe,
                                     [](const Observation& o, KeyFrameId id) { return o.first < id; });
    const bool is_known = at != seen.end() && at->first == state.keyframe;
    if (is_known && state.feature < 0) {
      seen.erase(at);
    } else if (is_known) {
      at->second = state.feature;
    } else if (state.feature >= 0) {
      seen.insert(at, {state.keyframe, state.feature});
    }
    return Ok{};
  }

  std::map<KeyFrameId, MapDelta::KeyFrameState> keyframes_;
  std::map<MapPointId, Point> points_;
};

}  // namespace

Result<MapDelta> MergeChanges(const MapDelta& snapshot, const std::vector<MapDelta>& changes) {
  if (changes.empty()) return snapshot;
  State state;
  if (Status applied = state.Apply(snapshot); !applied) return applied.error();
  MapDelta merged;
  merged.map = snapshot.map;
  merged.epoch = snapshot.epoch;
  merged.revision = snapshot.revision;
  for (const MapDelta& change : changes) {
    const std::string name = "the change from revision " + std::to_string(change.base_revision);
    if (change.map != merged.map || !Continues(change, merged.epoch, merged.revision))
      return Error{name + " does not continue revision " + std::to_string(merged.revision)};
    if (Status applied = state.Apply(change); !applied) return Error{name + ": " + applied.error().message};
    merged.revision = change.revision;
    merged.residuals = change.residuals;
  }
  state.WriteTo(&merged);
  return merged;
}

}  // namespace portolan
