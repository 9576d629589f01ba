#include "loop/map_follower.h"

namespace portolan {

bool MapFollower::AddKeyFrame(const KeyFrameMessage& message) {
  if (!message.map.IsValid() || (vocabulary_ != nullptr && message.vocabulary_hash != vocabulary_->hash()))
    return false;
  const auto replica = replicas_.replicas().find(message.map);
  const bool known =
      replica != replicas_.replicas().end() && replica->second.FindKeyFrameData(message.data.id) != nullptr;
  if (!known) replicas_.AddKeyFrameData(message.map, MakeKeyFrameData(message.data, vocabulary_.get()));
  return true;
}

void MapFollower::OnMapperState(const MapperState& state) {
  if (state.map.IsValid()) replicas_.Announce(state.map, state.epoch, state.revision);
}

void MapFollower::OnStatus(const ProcessStatus& status) {
  if (status.map.IsValid()) replicas_.Announce(status.map, status.epoch, status.revision);
}

std::vector<MapDelta> MapFollower::ApplyPending() {
  std::vector<MapDelta> applied = replicas_.ApplyPending();
  for (const MapDelta& delta : applied) {
    for (const auto& removed : delta.removed_keyframes) index_.Remove(removed.id);
  }
  for (const MapDelta& delta : applied) {
    active_map_ = delta.map;
    for (const auto& state : delta.keyframes) {
      if (index_.Find(state.id) != nullptr) continue;
      const KeyFrame* keyframe = map(delta.map).FindKeyFrame(state.id);  // null when a later delta removed it
      if (keyframe != nullptr) index_.Add(state.id, WordsOf(keyframe->data));
    }
  }
  return applied;
}

MapFollower::Summary MapFollower::Summarize(MapId id) const {
  const Map& of = map(id);
  Summary summary{id, of.epoch(), of.revision(), replicas_.Lag(id), of.keyframes().size(), of.points().size(), 0};
  size_t ends = 0;
  for (const auto& [keyframe_id, keyframe] : of.keyframes()) ends += of.CovisibleKeyFrames(keyframe_id, 1).size();
  summary.covisibility_edges = ends / 2;
  return summary;
}

std::vector<MapId> MapFollower::Maps() const {
  std::vector<MapId> maps;
  for (const auto& [id, replica] : replicas_.replicas()) {
    if (replica.map().revision() > 0) maps.push_back(id);
  }
  return maps;
}

std::map<MapId, uint64_t> MapFollower::Hashes() const {
  std::map<MapId, uint64_t> hashes;
  for (const MapId id : Maps()) hashes[id] = HashMap(map(id));
  return hashes;
}

}  // namespace portolan
