#include "mapping/warm_maps.h"

#include <algorithm>
#include <utility>

namespace portolan {

void WarmMaps::OnCommand(const Command& command) {
  switch (command.kind) {
    case CommandKind::kGrantOwnership:
      if (command.owner == self_) return;  // to be taken
      // The atlas_server's own maps are dormant, other robots' have their own standbys.
      if (command.owner == command.sender || command.owner.robot() != self_.robot()) return Forget(command.map);
      followed_[command.map] = command.owner;
      return;
    case CommandKind::kFuseMaps:
      replicas_.Remove(command.other, command.map);
      return Forget(command.other);
    case CommandKind::kForgetMap:
      replicas_.Remove(command.map);
      return Forget(command.map);
    default:
      return;
  }
}

void WarmMaps::OnMapperState(const MapperState& state) {
  if (state.process == self_ || state.process.robot() != self_.robot() || !state.map.IsValid()) return;
  followed_[state.map] = state.process;
  if (state.revision > 0) replicas_.Announce(state.map, state.epoch, state.revision);
}

void WarmMaps::AddKeyFrame(MapId map, const KeyFrameData& data) {
  if (!IsFollowed(map)) return;
  const auto replica = replicas_.replicas().find(map);
  if (replica != replicas_.replicas().end() && replica->second.FindKeyFrameData(data.id) != nullptr) return;
  replicas_.AddKeyFrameData(map, MakeKeyFrameData(data, nullptr));
}

void WarmMaps::AddChunk(MapDeltaChunk chunk) {
  if (IsFollowed(chunk.part.map)) replicas_.AddChunk(std::move(chunk));
}

std::vector<SnapshotRequest> WarmMaps::Update(double now_s) {
  const std::vector<MapDelta> applied = replicas_.ApplyPending();
  if (!applied.empty()) current_ = applied.back().map;
  return replicas_.DueRequests(now_s, self_);
}

bool WarmMaps::IsOwner(ProcessId process) const {
  return std::any_of(followed_.begin(), followed_.end(), [&](const auto& entry) { return entry.second == process; });
}

std::optional<MapReplica> WarmMaps::Take(MapId map) {
  std::optional<MapReplica> taken = replicas_.Take(map);
  Forget(map);
  return taken;
}

void WarmMaps::Forget(MapId map) {
  followed_.erase(map);
  told_.erase(map);
  replicas_.Forget(map);
}

std::vector<HeldMap> WarmMaps::TakeNews() {
  std::vector<HeldMap> news;
  for (const auto& [id, replica] : replicas_.replicas()) {
    const std::pair state(replica.map().epoch(), replica.map().revision());
    if (state.second == 0 || told_[id] == state) continue;
    told_[id] = state;
    news.push_back(MeasureMap(replica.map()));
  }
  return news;
}

const Map* WarmMaps::current() const {
  const auto replica = replicas_.replicas().find(current_);
  return replica == replicas_.replicas().end() ? nullptr : &replica->second.map();
}

Revision WarmMaps::Lag() const {
  Revision lag = 0;
  for (const auto& [id, replica] : replicas_.replicas()) lag = std::max(lag, replicas_.Lag(id));
  return lag;
}

size_t WarmMaps::num_missing() const {
  return static_cast<size_t>(std::count_if(
      replicas_.replicas().begin(), replicas_.replicas().end(),
      [this](const auto& entry) { return entry.second.map().revision() == 0 && replicas_.IsBehind(entry.first); }));
}

}  // namespace portolan
