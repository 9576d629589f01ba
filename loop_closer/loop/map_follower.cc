#include "loop/map_follower.h"

#include <algorithm>

namespace portolan {

void MapFollower::Follow(MapId map, Epoch epoch) {
  if (!map.IsValid() || replicas_.IsRemoved(map, epoch) || (!followed_.empty() && followed_.back() == map)) return;
  followed_.erase(std::remove(followed_.begin(), followed_.end(), map), followed_.end());
  followed_.push_back(map);
  if (followed_.size() <= kMaxFollowed) return;
  Unindex(followed_.front(), nullptr);
  replicas_.Forget(followed_.front());
  followed_.pop_front();
  ChooseActiveMap();
}

bool MapFollower::IsFollowed(MapId map) const {
  return std::find(followed_.begin(), followed_.end(), map) != followed_.end();
}

bool MapFollower::AddKeyFrame(const KeyFrameMessage& message) {
  if (!message.map.IsValid() || (vocabulary_ != nullptr && message.vocabulary_hash != vocabulary_->hash()))
    return false;
  if (message.kind != KeyFrameKind::kCopy && message.data.id.robot() == robot_) Follow(message.map);
  if (!IsFollowed(message.map)) return true;
  const auto replica = replicas_.replicas().find(message.map);
  const bool known =
      replica != replicas_.replicas().end() && replica->second.FindKeyFrameData(message.data.id) != nullptr;
  if (!known) replicas_.AddKeyFrameData(message.map, MakeKeyFrameData(message.data, vocabulary_.get()));
  return true;
}

void MapFollower::AddChunk(MapDeltaChunk chunk) {
  if (IsFollowed(chunk.part.map)) replicas_.AddChunk(std::move(chunk));
}

void MapFollower::OnMapperState(const MapperState& state) {
  if (state.process.robot() == robot_) Follow(state.map, state.epoch);
  if (IsFollowed(state.map)) replicas_.Announce(state.map, state.epoch, state.revision);
}

void MapFollower::OnStatus(const ProcessStatus& status) {
  if (status.process.robot() == robot_ && (status.role == "backend_mapper" || status.role == "frontend_tracker"))
    Follow(status.map, status.epoch);
  if (IsFollowed(status.map)) replicas_.Announce(status.map, status.epoch, status.revision);
}

void MapFollower::OnTrackerState(const TrackerState& state) {
  if (state.process.robot() != robot_ || !state.map.IsValid()) return;
  Follow(state.map);
  tracked_map_ = state.map;
  ChooseActiveMap();
}

void MapFollower::Fuse(MapId map, MapId other) {
  const bool is_followed = IsFollowed(other);
  if (is_followed) Follow(map);
  const auto into = replicas_.replicas().find(map);
  if (is_followed && into == replicas_.replicas().end()) {
    Unindex(other, nullptr);
  } else if (is_followed) {
    Unindex(other, &into->second.map());
  }
  replicas_.Remove(other, map);
  followed_.erase(std::remove(followed_.begin(), followed_.end(), other), followed_.end());
  if (tracked_map_ == other) tracked_map_ = map;
  ChooseActiveMap();
}

void MapFollower::Remove(MapId map) {
  Unindex(map, nullptr);
  replicas_.Remove(map);
  followed_.erase(std::remove(followed_.begin(), followed_.end(), map), followed_.end());
  ChooseActiveMap();
}

/// @param except a map whose keyframes stay in the index; may be null.
void MapFollower::Unindex(MapId map, const Map* except) {
  const auto replica = replicas_.replicas().find(map);
  if (replica == replicas_.replicas().end()) return;
  for (const auto& [id, keyframe] : replica->second.map().keyframes()) {
    if (except == nullptr || except->FindKeyFrame(id) == nullptr) index_.Remove(id);
  }
}

bool MapFollower::IsHere(MapId map) const {
  const auto replica = replicas_.replicas().find(map);
  return replica != replicas_.replicas().end() && replica->second.map().revision() > 0;
}

bool MapFollower::IsUpToDate(MapId map) const {
  return IsHere(map) && !replicas_.IsBehind(map);
}

void MapFollower::ChooseActiveMap() {
  if (IsHere(tracked_map_)) active_map_ = tracked_map_;
  if (!IsHere(active_map_)) active_map_ = MapId();
}

std::vector<MapDelta> MapFollower::ApplyPending() {
  std::vector<MapDelta> applied = replicas_.ApplyPending();
  for (const MapDelta& delta : applied) {
    for (const auto& removed : delta.removed_keyframes) index_.Remove(removed.id);
  }
  for (const MapDelta& delta : applied) {
    if (!tracked_map_.IsValid()) active_map_ = delta.map;
    for (const auto& state : delta.keyframes) {
      if (index_.Find(state.id) != nullptr) continue;
      const KeyFrame* keyframe = map(delta.map).FindKeyFrame(state.id);  // null when a later delta removed it
      if (keyframe != nullptr) index_.Add(state.id, WordsOf(keyframe->data));
    }
  }
  ChooseActiveMap();
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
