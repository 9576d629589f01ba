#include "tracking/followed_maps.h"

#include <utility>

namespace portolan {

void FollowedMaps::Follow(MapId map, bool exists) {
  if (!replicas_.emplace(map, MapReplica(map)).second) return;
  indices_.emplace(map, KeyFrameIndex());
  if (exists) fresh_.insert(map);
}

void FollowedMaps::Drop(MapId map) {
  replicas_.erase(map);
  indices_.erase(map);
  fresh_.erase(map);
}

const Map* FollowedMaps::Find(MapId map) const {
  const auto found = replicas_.find(map);
  return found == replicas_.end() ? nullptr : &found->second.map();
}

void FollowedMaps::AddDelta(MapDelta delta) {
  const auto replica = replicas_.find(delta.map);
  if (replica != replicas_.end()) replica->second.AddDelta(std::move(delta));
}

void FollowedMaps::AddKeyFrameData(MapId map, std::shared_ptr<const KeyFrameData> data) {
  const auto replica = replicas_.find(map);
  if (replica != replicas_.end()) replica->second.AddKeyFrameData(std::move(data));
}

std::shared_ptr<const KeyFrameData> FollowedMaps::FindKeyFrameData(KeyFrameId id) const {
  for (const auto& [map, replica] : replicas_) {
    if (auto data = replica.FindKeyFrameData(id)) return data;
  }
  return nullptr;
}

std::vector<MapId> FollowedMaps::Waiting() const {
  std::vector<MapId> maps;
  for (const auto& [map, replica] : replicas_) {
    if (replica.waiting() > 0) maps.push_back(map);
  }
  return maps;
}

std::vector<MapDelta> FollowedMaps::ApplyPending(MapId id) {
  MapReplica& replica = replicas_.at(id);
  KeyFrameIndex& index = indices_.at(id);
  std::vector<MapDelta> applied =
      replica.ApplyPending([this](KeyFrameId keyframe) { return FindKeyFrameData(keyframe); });
  for (const MapDelta& delta : applied) {
    for (const MapDelta::KeyFrameState& state : delta.keyframes) {
      // Null if a later delta of the same batch removed it again.
      const KeyFrame* keyframe = replica.map().FindKeyFrame(state.id);
      if (keyframe != nullptr && index.Find(state.id) == nullptr) index.Add(state.id, WordsOf(keyframe->data));
    }
    for (const MapDelta::RemovedKeyFrame& removed : delta.removed_keyframes) index.Remove(removed.id);
  }
  if (!applied.empty()) fresh_.erase(id);
  return applied;
}

std::vector<const MapReplica*> FollowedMaps::InNeed() const {
  std::vector<const MapReplica*> in_need;
  for (const auto& [map, replica] : replicas_) {
    if (replica.NeedsSnapshot() || IsFresh(map)) in_need.push_back(&replica);
  }
  return in_need;
}

}  // namespace portolan
