// How a map turns its changes into deltas, and follows the deltas of its owner.

#include <algorithm>
#include <set>
#include <string>
#include <unordered_map>
#include <utility>
#include <vector>

#include "base/check.h"
#include "map/delta_check.h"
#include "map/map.h"

namespace portolan {
namespace {

constexpr size_t kMinObservations = 2;  // of a point: with fewer it has no position

MapDelta::KeyFrameState StateOf(const KeyFrame& keyframe) {
  return {keyframe.data->id, keyframe.camera_from_map, keyframe.parent,
          static_cast<uint32_t>(keyframe.landmarks.num_features())};
}

}  // namespace

void Map::RemoveUnseenPoints() {
  std::set<MapPointId> touched = changes_.points;
  for (const auto& [key, feature] : changes_.observations) touched.insert(key.first);
  for (const MapPointId id : touched) {
    if (point(id).observations.size() < kMinObservations) RemovePoint(id);
  }
}

MapDelta Map::TakeDelta() {
  RemoveUnseenPoints();
  RefreshDerived();
  MapDelta delta;
  delta.map = id_;
  delta.epoch = epoch_;
  delta.base_revision = revision_;
  delta.residuals = residuals_;
  delta.removed_points = std::move(changes_.removed_points);
  delta.removed_keyframes = std::move(changes_.removed_keyframes);
  for (const KeyFrameId id : changes_.keyframes) delta.keyframes.push_back(StateOf(keyframe(id)));
  for (const MapPointId id : changes_.points) delta.points.push_back({id, point(id).position_in_map});
  for (const auto& [key, feature] : changes_.observations) {
    // An observation in a keyframe that is gone went with it.
    if (keyframes_.count(key.second) == 1) delta.observations.push_back({key.first, key.second, feature});
  }
  changes_ = Changes();
  delta.revision = delta.IsEmpty() ? revision_ : ++revision_;
  return delta;
}

MapDelta Map::Snapshot() const {
  MapDelta delta;
  delta.map = id_;
  delta.epoch = epoch_;
  delta.base_revision = 0;
  delta.revision = revision_;
  delta.residuals = residuals_;
  // Parents before children, so that a part of a snapshot never refers ahead: ids rise with age.
  for (const auto& [id, keyframe] : keyframes_) delta.keyframes.push_back(StateOf(keyframe));
  size_t num_observations = 0;
  for (const auto& [id, point] : points_) num_observations += point.observations.size();
  delta.points.reserve(points_.size());
  delta.observations.reserve(num_observations);
  for (const MapPointId id : SortedPointIds()) {
    const MapPoint& point = points_.at(id);
    if (point.observations.size() < kMinObservations) continue;
    delta.points.push_back({id, point.position_in_map});
    for (const Observation& o : point.observations) {
      delta.observations.push_back({id, o.keyframe, static_cast<int32_t>(o.feature)});
    }
  }
  return delta;
}

Status Map::CheckOrigin(const MapDelta& delta) const {
  if (delta.map != id_) return Error{"delta of map " + ToString(delta.map) + " for map " + ToString(id_)};
  const std::string of_epoch =
      "delta of epoch " + std::to_string(delta.epoch) + " for a map in epoch " + std::to_string(epoch_);
  if (delta.epoch < epoch_) return Error{of_epoch};
  if (delta.IsSnapshot()) return Ok{};
  // A new owner may go on from an older state than ours: equal revisions of two epochs need not be equal states.
  if (delta.epoch > epoch_) return Error{of_epoch + ": a snapshot must come first"};
  if (delta.base_revision != revision_) {
    return Error{"delta from revision " + std::to_string(delta.base_revision) + " for a map at " +
                 std::to_string(revision_)};
  }
  if (delta.revision <= delta.base_revision) {
    return Error{"delta from revision " + std::to_string(delta.base_revision) + " back to " +
                 std::to_string(delta.revision)};
  }
  return Ok{};
}

Status Map::Apply(const MapDelta& delta, const FindData& find_data) {
  if (Status status = CheckOrigin(delta); !status) return status;
  if (delta.IsSnapshot()) {
    Map fresh(id_, delta.epoch);
    if (Status status = CheckDelta(fresh, delta, find_data); !status) return status;
    fresh.ApplyChecked(delta, find_data);
    fresh.TakeMissingDescriptors(*this);
    *this = std::move(fresh);
    return Ok{};
  }
  Status checked = CheckDelta(*this, delta, find_data);
  if (checked) ApplyChecked(delta, find_data);
  return checked;
}

void Map::ReplaceData(KeyFrameId id, std::shared_ptr<const KeyFrameData> data) {
  KeyFrame& keyframe = MutableKeyFrame(id);
  PORTOLAN_CHECK(data->id == id && data->features.size() == keyframe.landmarks.num_features())
      << "data of " << data->id;
  keyframe.data = WithKnownResidual(std::move(data));
  if (!keyframe.data->features.HasAppearance()) return;
  for (const MapPointId landmark : keyframe.landmarks) {
    MapPoint& point = points_.at(landmark);
    if (point.descriptor == Descriptor())
      point.descriptor = keyframe.data->features.descriptors[point.FindObservation(id)->feature];
  }
}

/// Of points none of whose keyframes has descriptors here.
void Map::TakeMissingDescriptors(const Map& from) {
  for (auto& [id, point] : points_) {
    if (point.descriptor != Descriptor()) continue;
    if (const MapPoint* known = from.FindPoint(id)) point.descriptor = known->descriptor;
  }
}

void Map::ApplyChecked(const MapDelta& delta, const FindData& find_data) {
  ApplyRemovals(delta);
  if (delta.residuals != residuals_) TakeResiduals(delta.residuals);
  for (const auto& state : delta.keyframes) {
    if (keyframes_.count(state.id) == 0) AddKeyFrame(find_data(state.id), state.camera_from_map, KeyFrameId());
    SetPose(state.id, state.camera_from_map);
    MutableKeyFrame(state.id).parent = state.parent;  // may come after its child in the delta
  }
  if (delta.IsSnapshot()) points_.reserve(delta.points.size());
  for (const auto& state : delta.points) {
    MapPoint& point = points_[state.id];
    point.id = state.id;
    if (point.position_in_map != state.position_in_map) MarkStale(&point, kGeometryStale);
    // Also where only the sign of a zero differs: replicas are equal to the bit.
    point.position_in_map = state.position_in_map;
  }
  ApplyObservations(delta);
  RefreshDerived();
  changes_ = Changes();
  epoch_ = delta.epoch;
  revision_ = delta.revision;
}

void Map::ApplyRemovals(const MapDelta& delta) {
  for (const auto& removed : delta.removed_points) {
    const auto found = points_.find(removed.id);
    if (found == points_.end()) continue;
    UnlinkAll(&found->second);
    points_.erase(found);
  }
  for (const auto& removed : delta.removed_keyframes) {
    const KeyFrame* keyframe = FindKeyFrame(removed.id);
    if (keyframe == nullptr) continue;
    const KeyFrameLandmarks landmarks = keyframe->landmarks;
    for (const MapPointId landmark : landmarks) RemoveObservation(landmark, removed.id);
    keyframes_.erase(removed.id);
    covisibility_.Forget(removed.id);
  }
}

void Map::ApplyObservations(const MapDelta& delta) {
  if (delta.IsSnapshot()) return PutAllObservations(delta);
  // Removals first: a feature may pass from one landmark to another within a delta.
  for (const auto& o : delta.observations) {
    MapPoint& point = points_.at(o.point);
    const Observation* seen = point.FindObservation(o.keyframe);
    if (seen == nullptr || static_cast<int64_t>(seen->feature) == o.feature) continue;
    UnlinkObservation(&point, static_cast<size_t>(seen - point.observations.data()));
  }
  for (const auto& o : delta.observations) {
    MapPoint& point = points_.at(o.point);
    if (o.feature < 0 || point.FindObservation(o.keyframe) != nullptr) continue;
    LinkObservation(&point, o.keyframe, static_cast<uint32_t>(o.feature));
  }
}

/// Of a whole map, which has none yet. Landmarks and neighbours of its keyframes are put down at once, at its end: one
/// by one, and pair by pair, that takes seconds for a thousand keyframes.
void Map::PutAllObservations(const MapDelta& delta) {
  std::unordered_map<KeyFrameId, std::vector<std::pair<uint32_t, MapPointId>>> seen;  // features and what they show
  MapPoint* point = nullptr;  // its observations come one after another, as owners send them
  for (const auto& o : delta.observations) {
    if (o.feature < 0) continue;
    if (point == nullptr || point->id != o.point) point = &points_.at(o.point);
    const auto feature = static_cast<uint32_t>(o.feature);
    point->InsertObservation({o.keyframe, feature});
    MarkStale(point, kGeometryStale | kDescriptorStale);
    seen[o.keyframe].emplace_back(feature, o.point);
  }
  for (auto& [id, landmarks] : seen) {
    std::sort(landmarks.begin(), landmarks.end());  // each goes behind the last
    KeyFrame& keyframe = MutableKeyFrame(id);
    for (const auto& [feature, landmark] : landmarks) keyframe.landmarks.Set(feature, landmark);
  }
  FillCovisibility();
}

/// From all observations; there are no neighbours yet.
void Map::FillCovisibility() {
  std::vector<KeyFrameId> ids;
  std::unordered_map<KeyFrameId, uint32_t> places;
  for (const auto& [id, keyframe] : keyframes_) {
    places.emplace(id, static_cast<uint32_t>(ids.size()));
    ids.push_back(id);
  }
  std::vector<std::vector<uint32_t>> seen_by;
  seen_by.reserve(points_.size());
  for (const auto& [id, point] : points_) {
    std::vector<uint32_t>& keyframes = seen_by.emplace_back();
    for (const Observation& o : point.observations) keyframes.push_back(places.at(o.keyframe));
  }
  covisibility_.Fill(ids, seen_by);
}

}  // namespace portolan
