#include "map/delta_check.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <tuple>
#include <unordered_map>
#include <unordered_set>
#include <utility>

namespace portolan {

bool IsSoundPose(const Rigid3d& pose) {
  return pose.translation.allFinite() && pose.translation.cwiseAbs().maxCoeff() < kMaxCoordinate &&
         pose.rotation.coeffs().allFinite() && std::abs(pose.rotation.norm() - 1.0) < 1e-6;
}

bool IsSoundPosition(const Eigen::Vector3f& position) {
  return position.allFinite() && position.cwiseAbs().maxCoeff() < static_cast<float>(kMaxCoordinate);
}

namespace {

template <class IdType>
Error About(const char* what, IdType id, const char* problem) {
  return Error{std::string(what) + " " + ToString(id) + " " + problem};
}

using ObservationState = MapDelta::ObservationState;

bool Before(const ObservationState& a, const ObservationState& b) {
  return std::tie(a.point, a.keyframe) < std::tie(b.point, b.keyframe);
}

class DeltaChecker {
 public:
  DeltaChecker(const Map& map, const MapDelta& delta, const Map::FindData& find_data)
      : map_(map), delta_(delta), find_data_(find_data) {}

  Status Check() {
    for (const auto step : {&DeltaChecker::CheckRemovedIds, &DeltaChecker::CheckKeyFrames, &DeltaChecker::CheckPoints,
                            &DeltaChecker::CheckHeirs, &DeltaChecker::CheckRoots, &DeltaChecker::CheckParents,
                            &DeltaChecker::CheckResiduals, &DeltaChecker::SortObservations,
                            &DeltaChecker::CheckObservations, &DeltaChecker::CheckCounts}) {
      if (Status status = (this->*step)(); !status) return status;
    }
    return Ok{};
  }

 private:
  // The map as it will be.
  bool HasKeyFrame(KeyFrameId id) const {
    return new_keyframes_.count(id) == 1 || (map_.FindKeyFrame(id) != nullptr && removed_keyframes_.count(id) == 0);
  }
  bool HasPoint(MapPointId id) const {
    return new_points_.count(id) == 1 || (map_.FindPoint(id) != nullptr && removed_points_.count(id) == 0);
  }
  KeyFrameId ParentOf(KeyFrameId id) const {
    const auto changed = parents_.find(id);
    return changed != parents_.end() ? changed->second : map_.keyframe(id).parent;
  }

  Status CheckRemovedIds() {
    for (size_t i = 0; i < delta_.removed_points.size(); ++i) {
      if (!removed_points_.emplace(delta_.removed_points[i].id, i).second) {
        return About("point", delta_.removed_points[i].id, "is removed twice");
      }
    }
    for (size_t i = 0; i < delta_.removed_keyframes.size(); ++i) {
      const auto& removed = delta_.removed_keyframes[i];
      if (!removed_keyframes_.emplace(removed.id, i).second) return About("keyframe", removed.id, "is removed twice");
      if (!IsSoundPose(removed.removed_from_anchor))
        return About("removed keyframe", removed.id, "has a pose that is not a finite rigid motion");
    }
    return Ok{};
  }

  Status CheckKeyFrames() {
    for (const auto& state : delta_.keyframes) {
      if (!state.id.IsValid()) return Error{"a keyframe has no id"};
      if (!IsSoundPose(state.camera_from_map))
        return About("keyframe", state.id, "has a pose that is not a finite rigid motion");
      if (removed_keyframes_.count(state.id) == 1) return About("keyframe", state.id, "is both removed and changed");
      if (!parents_.emplace(state.id, state.parent).second) return About("keyframe", state.id, "is in the delta twice");
      const KeyFrame* known = map_.FindKeyFrame(state.id);
      size_t num_features = 0;
      if (known != nullptr) {
        num_features = known->landmarks.num_features();
        if (known->parent != state.parent) known_parents_change_ = true;
      } else {
        const std::shared_ptr<const KeyFrameData> data = find_data_(state.id);
        if (data == nullptr) return About("data of keyframe", state.id, "is missing");
        if (data->id != state.id) return About("data of keyframe", state.id, "is another's");
        num_features = data->features.size();
        new_keyframes_.emplace(state.id, num_features);
      }
      if (num_features != state.num_features) return About("keyframe", state.id, "has another number of features");
    }
    return Ok{};
  }

  Status CheckPoints() {
    MapPointId last;
    bool ascending = true;
    for (const auto& state : delta_.points) {
      if (!state.id.IsValid()) return Error{"a point has no id"};
      if (!IsSoundPosition(state.position_in_map)) return About("point", state.id, "has a position that is not finite");
      if (removed_points_.count(state.id) == 1) return About("point", state.id, "is both removed and changed");
      if (map_.FindPoint(state.id) == nullptr) new_points_.insert(state.id);
      ascending = ascending && last < state.id;
      last = state.id;
    }
    if (ascending) return Ok{};  // as owners send them
    std::unordered_set<MapPointId> seen;
    for (const auto& state : delta_.points) {
      if (!seen.insert(state.id).second) return About("point", state.id, "is in the delta twice");
    }
    return Ok{};
  }

  /// Who takes over from what is removed must stay, or be removed after it.
  Status CheckHeirs() {
    for (size_t i = 0; i < delta_.removed_points.size(); ++i) {
      const MapPointId heir = delta_.removed_points[i].replaced_by;
      if (!heir.IsValid() || HasPoint(heir)) continue;
      const auto removed = removed_points_.find(heir);
      if (removed == removed_points_.end() || removed->second <= i)
        return About("replacing point", heir, "is not known");
    }
    for (size_t i = 0; i < delta_.removed_keyframes.size(); ++i) {
      const KeyFrameId heir = delta_.removed_keyframes[i].anchor;
      if (HasKeyFrame(heir)) continue;
      const auto removed = removed_keyframes_.find(heir);
      if (removed == removed_keyframes_.end() || removed->second <= i) return About("anchor", heir, "is not known");
    }
    return Ok{};
  }

  Status CheckRoots() {
    size_t count = map_.keyframes().size() + new_keyframes_.size();
    int roots = map_.keyframes().empty() ? 0 : 1;
    for (const auto& [id, index] : removed_keyframes_) {
      const KeyFrame* known = map_.FindKeyFrame(id);
      if (known == nullptr) continue;
      --count;
      if (!known->parent.IsValid()) --roots;
    }
    for (const auto& state : delta_.keyframes) {
      const KeyFrame* known = map_.FindKeyFrame(state.id);
      if (known != nullptr && !known->parent.IsValid()) --roots;
      if (!state.parent.IsValid()) ++roots;
    }
    if (count > 0 && roots != 1) return Error{"the spanning tree would have " + std::to_string(roots) + " roots"};
    return Ok{};
  }

  Status CheckParents() {
    for (const auto& state : delta_.keyframes) {
      if (state.parent.IsValid() && !HasKeyFrame(state.parent)) return About("parent", state.parent, "is not known");
    }
    if (!removed_keyframes_.empty()) {
      for (const auto& [id, keyframe] : map_.keyframes()) {
        if (removed_keyframes_.count(id) == 0 && removed_keyframes_.count(ParentOf(id)) == 1)
          return About("parent of", id, "is removed");
      }
    }
    // Only keyframes in the delta can close a circle; walks end at what is known to lead to the root.
    std::unordered_set<KeyFrameId> sound;
    const size_t most = map_.keyframes().size() + new_keyframes_.size();
    for (const auto& state : delta_.keyframes) {
      std::vector<KeyFrameId> path;
      for (KeyFrameId id = state.id; id.IsValid() && sound.count(id) == 0; id = ParentOf(id)) {
        if (!known_parents_change_ && new_keyframes_.count(id) == 0) break;
        path.push_back(id);
        if (path.size() > most) return About("keyframe", state.id, "would hang on a circle of parents");
      }
      sound.insert(path.begin(), path.end());
    }
    return Ok{};
  }

  Status CheckResiduals() {
    for (const CameraResidual& known : delta_.residuals) {
      if (!IsSound(known.residual)) return Error{"a camera's residual is out of range"};
    }
    return Ok{};
  }

  Status SortObservations() {
    observations_.reserve(delta_.observations.size());
    for (const ObservationState& o : delta_.observations) observations_.push_back(&o);
    const auto before = [](const ObservationState* a, const ObservationState* b) { return Before(*a, *b); };
    if (!std::is_sorted(observations_.begin(), observations_.end(), before))
      std::sort(observations_.begin(), observations_.end(), before);
    for (size_t i = 1; i < observations_.size(); ++i) {
      if (!before(observations_[i - 1], observations_[i]))
        return About("an observation of point", observations_[i]->point, "is in the delta twice");
    }
    return Ok{};
  }

  bool IsObservationInDelta(MapPointId point, KeyFrameId keyframe) const {
    const ObservationState wanted{point, keyframe, 0};
    const auto found =
        std::lower_bound(observations_.begin(), observations_.end(), &wanted,
                         [](const ObservationState* a, const ObservationState* b) { return Before(*a, *b); });
    return found != observations_.end() && (*found)->point == point && (*found)->keyframe == keyframe;
  }

  Status CheckObservations() {
    for (const ObservationState* o : observations_) {
      if (!HasPoint(o->point)) return About("observed point", o->point, "is not known");
      if (!HasKeyFrame(o->keyframe)) return About("observing keyframe", o->keyframe, "is not known");
      const KeyFrame* known = map_.FindKeyFrame(o->keyframe);
      const size_t num_features = known != nullptr ? known->landmarks.num_features() : new_keyframes_.at(o->keyframe);
      if (o->feature < -1 || o->feature >= static_cast<int64_t>(num_features)) {
        return Error{"feature " + std::to_string(o->feature) + " of keyframe " + ToString(o->keyframe) +
                     " is out of range"};
      }
      const MapPoint* point = map_.FindPoint(o->point);
      const bool was_seen = point != nullptr && point->FindObservation(o->keyframe) != nullptr;
      if (was_seen != (o->feature >= 0)) gains_.emplace_back(o->point, was_seen ? -1 : 1);
      if (o->feature >= 0 && !ClaimFeature(*o, known, num_features)) {
        return Error{"feature " + std::to_string(o->feature) + " of keyframe " + ToString(o->keyframe) +
                     " is another landmark's"};
      }
    }
    return Ok{};
  }

  bool ClaimFeature(const ObservationState& o, const KeyFrame* known, size_t num_features) {
    const auto feature = static_cast<size_t>(o.feature);
    if (known != nullptr) {
      const MapPointId holder = known->landmarks[feature];
      const bool is_held = holder.IsValid() && holder != o.point && removed_points_.count(holder) == 0;
      if (is_held && !IsObservationInDelta(holder, o.keyframe)) return false;
    }
    std::vector<bool>& claimed = claimed_[o.keyframe];
    claimed.resize(num_features);
    if (claimed[feature]) return false;
    claimed[feature] = true;
    return true;
  }

  /// Points that gain too little or lose too much.
  Status CheckCounts() {
    for (const MapPointId id : new_points_) gains_.emplace_back(id, 0);
    for (const auto& [id, index] : removed_keyframes_) {
      const KeyFrame* known = map_.FindKeyFrame(id);
      if (known == nullptr) continue;
      for (const MapPointId landmark : known->landmarks) {
        if (removed_points_.count(landmark) == 0) gains_.emplace_back(landmark, -1);
      }
    }
    std::sort(gains_.begin(), gains_.end());
    for (size_t i = 0; i < gains_.size();) {
      const MapPointId id = gains_[i].first;
      const MapPoint* known = map_.FindPoint(id);
      ptrdiff_t count = known != nullptr ? static_cast<ptrdiff_t>(known->observations.size()) : 0;
      for (; i < gains_.size() && gains_[i].first == id; ++i) count += gains_[i].second;
      if (count < 2) return About("point", id, "would be seen by fewer than two keyframes");
    }
    return Ok{};
  }

  const Map& map_;
  const MapDelta& delta_;
  const Map::FindData& find_data_;
  std::unordered_map<MapPointId, size_t> removed_points_;     // place in the delta's list
  std::unordered_map<KeyFrameId, size_t> removed_keyframes_;  // the same
  std::unordered_map<KeyFrameId, size_t> new_keyframes_;      // number of features
  std::unordered_set<MapPointId> new_points_;
  std::unordered_map<KeyFrameId, KeyFrameId> parents_;  // of the delta's keyframes
  bool known_parents_change_ = false;
  std::vector<const ObservationState*> observations_;          // by point, then keyframe
  std::unordered_map<KeyFrameId, std::vector<bool>> claimed_;  // features that the delta's observations take
  std::vector<std::pair<MapPointId, int>> gains_;              // of observations, by point
};

}  // namespace

Status CheckDelta(const Map& map, const MapDelta& delta, const Map::FindData& find_data) {
  return DeltaChecker(map, delta, find_data).Check();
}

}  // namespace portolan
