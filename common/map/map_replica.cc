#include "map/map_replica.h"

#include <algorithm>
#include <unordered_set>
#include <utility>

namespace portolan {
namespace {

/// What of a map's keyframes a snapshot no longer has, as the deltas that were missed would have told: what hangs on
/// one of them passes to the nearest keyframe above it that stays.
std::vector<MapDelta::RemovedKeyFrame> FindVanished(const Map& before, const MapDelta& snapshot) {
  std::unordered_set<KeyFrameId> staying;
  for (const auto& state : snapshot.keyframes) staying.insert(state.id);
  std::vector<MapDelta::RemovedKeyFrame> vanished;
  for (const auto& [id, keyframe] : before.keyframes()) {
    if (staying.count(id) == 1) continue;
    KeyFrameId anchor = keyframe.parent;
    while (anchor.IsValid() && staying.count(anchor) == 0) anchor = before.keyframe(anchor).parent;
    if (!anchor.IsValid()) continue;
    const Rigid3d anchor_from_map = before.keyframe(anchor).camera_from_map;
    vanished.push_back({id, anchor, keyframe.camera_from_map * anchor_from_map.Inverse()});
  }
  return vanished;
}

}  // namespace

void MapReplica::AddKeyFrameData(std::shared_ptr<const KeyFrameData> data) {
  const KeyFrameId id = data->id;
  data_.emplace(id, std::move(data));
}

std::shared_ptr<const KeyFrameData> MapReplica::FindKeyFrameData(KeyFrameId id) const {
  const auto found = data_.find(id);
  return found == data_.end() ? nullptr : found->second;
}

void MapReplica::DropAppearance(KeyFrameId id) {
  const auto found = data_.find(id);
  if (found == data_.end() || !found->second->features.HasAppearance()) return;
  found->second = WithoutAppearance(*found->second);
  if (map_.FindKeyFrame(id) != nullptr) map_.ReplaceData(id, found->second);
}

void MapReplica::RestoreAppearance(std::shared_ptr<const KeyFrameData> data) {
  const KeyFrameId id = data->id;
  const auto found = data_.find(id);
  if (found == data_.end()) return;
  found->second = std::move(data);
  if (map_.FindKeyFrame(id) == nullptr) return;
  map_.ReplaceData(id, found->second);
  found->second = map_.keyframe(id).data;  // without the residual that the map knows of
}

void MapReplica::DropKeyFrameData(KeyFrameId id) {
  if (map_.FindKeyFrame(id) == nullptr) data_.erase(id);
}

void MapReplica::AddDelta(MapDelta delta) {
  if (delta.map != map_.id()) {
    ++counters_.rejected;
    return;
  }
  if (waiting_.size() >= kMaxWaiting) {
    waiting_.pop_front();
    ++counters_.overflow;
    needs_snapshot_ = true;
  }
  // Ordered by revision, so that what was overtaken on the way falls into place.
  const auto after = std::upper_bound(waiting_.begin(), waiting_.end(), delta, [](const MapDelta& a, const Waiting& b) {
    return std::make_pair(a.epoch, a.revision) < std::make_pair(b.delta.epoch, b.delta.revision);
  });
  waiting_.insert(after, {std::move(delta)});
}

bool MapReplica::IsOutdated(const MapDelta& delta) {
  if (delta.epoch < map_.epoch()) {
    ++counters_.stale_epoch;
    return true;
  }
  if (delta.epoch == map_.epoch() && delta.revision <= map_.revision()) {
    ++counters_.repeated;
    return true;
  }
  return false;
}

bool MapReplica::Fits(const MapDelta& delta) const {
  return delta.IsSnapshot() || (delta.epoch == map_.epoch() && delta.base_revision == map_.revision());
}

bool MapReplica::TryApply(MapDelta* delta, const Map::FindData& elsewhere) {
  const auto find_data = [&](KeyFrameId id) {
    std::shared_ptr<const KeyFrameData> own = FindKeyFrameData(id);
    return own == nullptr && elsewhere ? elsewhere(id) : own;
  };
  std::vector<MapDelta::RemovedKeyFrame> vanished;
  if (delta->IsSnapshot()) vanished = FindVanished(map_, *delta);
  if (Status status = map_.Apply(*delta, find_data); !status) {
    last_problem_ = status.error().message;
    return false;
  }
  ++counters_.applied;
  for (const auto& state : delta->keyframes) AddKeyFrameData(map_.keyframe(state.id).data);
  delta->removed_keyframes.insert(delta->removed_keyframes.end(), vanished.begin(), vanished.end());
  for (const auto& removed : delta->removed_keyframes) data_.erase(removed.id);
  for (const auto& state : delta->keyframes) {  // as the map has it: its residual may have changed it
    if (const auto found = data_.find(state.id); found != data_.end()) found->second = map_.keyframe(state.id).data;
  }
  return true;
}

/// A snapshot has come. What was overtaken by it is outdated, what follows it fits: the rest waits in vain, unless the
/// snapshot was made, for someone else, before what is missing. That is not so time and again.
void MapReplica::GiveUpOutlived() {
  for (Waiting& waiting : waiting_) ++waiting.snapshots_outlived;
  const auto is_vain = [](const Waiting& waiting) { return waiting.snapshots_outlived >= kMaxOutlived; };
  const auto vain = std::remove_if(waiting_.begin(), waiting_.end(), is_vain);
  counters_.rejected += static_cast<uint64_t>(waiting_.end() - vain);
  waiting_.erase(vain, waiting_.end());
}

std::vector<MapDelta> MapReplica::ApplyPending(const Map::FindData& elsewhere) {
  std::vector<MapDelta> applied;
  bool snapshot_came = false;
  needs_snapshot_ = false;
  for (auto next = waiting_.begin(); next != waiting_.end();) {
    if (IsOutdated(next->delta)) {
      snapshot_came |= next->delta.IsSnapshot();
      next = waiting_.erase(next);
    } else if (Fits(next->delta) && TryApply(&next->delta, elsewhere)) {
      snapshot_came |= next->delta.IsSnapshot();
      needs_snapshot_ = false;
      applied.push_back(std::move(next->delta));
      waiting_.erase(next);
      next = waiting_.begin();
    } else {
      needs_snapshot_ = true;  // what closes the gap may be further back in the queue
      ++next;
    }
  }
  if (snapshot_came) GiveUpOutlived();
  needs_snapshot_ = needs_snapshot_ && !waiting_.empty();
  if (needs_snapshot_) ++counters_.gaps;
  return applied;
}

SnapshotRequest MapReplica::MakeRequest(ProcessId asker) const {
  SnapshotRequest request;
  request.map = map_.id();
  request.have_revision = map_.revision();
  request.asker = asker;
  for (const auto& [id, data] : data_) request.have_keyframes.push_back(id);
  return request;
}

}  // namespace portolan
