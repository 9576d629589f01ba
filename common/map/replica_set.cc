#include "map/replica_set.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace portolan {
namespace {

/// Requests in a row after which the interval between them doubles: a few may get lost with a link or an owner.
constexpr int kRequestsBeforeLess = 4;
/// As many are counted as make the interval longer than the longest.
constexpr int kMaxRequestsCounted = 8 * kRequestsBeforeLess;

/// Whether a condition has held for longer than the patience; `since` keeps when it began.
bool HeldFor(bool condition, double patience_s, double now_s, std::optional<double>* since) {
  if (!condition) since->reset();
  if (condition && !*since) *since = now_s;
  return condition && now_s - **since >= patience_s;
}

void Add(const MapReplica::Counters& counted, MapReplica::Counters* sum) {
  sum->applied += counted.applied;
  sum->stale_epoch += counted.stale_epoch;
  sum->repeated += counted.repeated;
  sum->rejected += counted.rejected;
  sum->gaps += counted.gaps;
  sum->overflow += counted.overflow;
}

/// Data of keyframes that are not in the map; all that are in it have theirs.
size_t CountUnusedData(const MapReplica& replica) {
  return replica.keyframe_data().size() - replica.map().keyframes().size();
}

}  // namespace

MapReplica* ReplicaSet::Replica(MapId map) {
  const auto known = replicas_.find(map);
  if (known != replicas_.end()) {
    watches_[map].last_heard = ++heard_;
    return &known->second;
  }
  if (replicas_.size() >= kMaxMaps) {
    ++other_counters_.rejected;
    return nullptr;
  }
  ForgetLongestUnheardEmptyMap();
  watches_[map].last_heard = ++heard_;
  return &replicas_.try_emplace(map, map).first->second;
}

/// If there are as many as there may be.
void ReplicaSet::ForgetLongestUnheardEmptyMap() {
  std::vector<std::pair<uint64_t, MapId>> empty;
  for (const auto& [id, replica] : replicas_) {
    if (replica.map().revision() == 0) empty.emplace_back(watches_[id].last_heard, id);
  }
  if (empty.size() < kMaxEmptyMaps) return;
  Forget(std::min_element(empty.begin(), empty.end())->second);
}

/// In any map: whoever looks knows that it is not in its own.
std::shared_ptr<const KeyFrameData> ReplicaSet::FindKeyFrameData(KeyFrameId id) const {
  for (const auto& [map, replica] : replicas_) {
    if (auto found = replica.FindKeyFrameData(id)) return found;
  }
  return nullptr;
}

bool ReplicaSet::IsRemoved(MapId map, Epoch epoch) const {
  const auto removed = removed_.find(map);
  return removed != removed_.end() && epoch <= removed->second;
}

Epoch ReplicaSet::RemovedEpoch(MapId map) const {
  const auto removed = removed_.find(map);
  return removed == removed_.end() ? 0 : removed->second;
}

std::optional<MapReplica> ReplicaSet::Take(MapId map) {
  const auto replica = replicas_.find(map);
  if (replica == replicas_.end()) return std::nullopt;
  std::optional<MapReplica> taken(std::move(replica->second));
  Forget(map);
  return taken;
}

void ReplicaSet::Put(MapReplica replica) {
  const MapId map = replica.map().id();
  watches_[map].last_heard = ++heard_;
  replicas_.insert_or_assign(map, std::move(replica));
}

void ReplicaSet::Forget(MapId map) {
  const auto replica = replicas_.find(map);
  if (replica != replicas_.end()) {
    Add(replica->second.counters(), &other_counters_);
    replicas_.erase(replica);
  }
  watches_.erase(map);
}

void ReplicaSet::Remove(MapId map) {
  Epoch& epoch = removed_[map];
  if (const auto replica = replicas_.find(map); replica != replicas_.end())
    epoch = std::max(epoch, replica->second.map().epoch());
  if (const auto watch = watches_.find(map); watch != watches_.end()) epoch = std::max(epoch, watch->second.epoch);
  Forget(map);
}

void ReplicaSet::Remove(MapId map, MapId taken_into) {
  const auto from = replicas_.find(map);
  const auto into = replicas_.find(taken_into);
  if (from != replicas_.end() && into != replicas_.end() && from != into) {
    for (const auto& [id, data] : from->second.keyframe_data()) into->second.AddKeyFrameData(data);
  }
  Remove(map);
}

void ReplicaSet::AddKeyFrameData(MapId map, std::shared_ptr<const KeyFrameData> data) {
  if (IsRemoved(map, 0)) return;  // one that comes back begins with a delta or an announcement
  MapReplica* replica = Replica(map);
  if (replica == nullptr) return;
  replica->AddKeyFrameData(std::move(data));
  const size_t unused = CountUnusedData(*replica);
  const bool expects_snapshot =
      replica->waiting() > 0 || IsBehind(replica->map(), watches_[map]);  // with the data ahead of it
  if (!expects_snapshot && unused > kMaxUnusedData) DropUnusedData(kMaxUnusedData, replica);
  if (expects_snapshot && NumUnusedData() > kMaxExpectedData) DropUnusedData(unused - 1, replica);
}

size_t ReplicaSet::NumUnusedData() const {
  size_t unused = 0;
  for (const auto& [id, replica] : replicas_) unused += CountUnusedData(replica);
  return unused;
}

void ReplicaSet::DropUnusedData(size_t kept, MapReplica* replica) {
  std::vector<KeyFrameId> unused;  // ids of one session rise with age
  for (const auto& [id, data] : replica->keyframe_data()) {
    if (replica->map().FindKeyFrame(id) == nullptr) unused.push_back(id);
  }
  for (size_t i = 0; i + kept < unused.size(); ++i) replica->DropKeyFrameData(unused[i]);
}

void ReplicaSet::AddDelta(MapDelta delta) {
  const MapId map = delta.map;
  if (IsRemoved(map, delta.epoch)) return;
  removed_.erase(map);
  if (MapReplica* replica = Replica(map)) replica->AddDelta(std::move(delta));
}

void ReplicaSet::AddChunk(MapDeltaChunk chunk) {
  for (MapDelta& delta : assembler_.Add(std::move(chunk))) AddDelta(std::move(delta));
}

void ReplicaSet::Announce(MapId map, Epoch epoch, Revision revision) {
  if (IsRemoved(map, epoch)) return;
  removed_.erase(map);
  if (Replica(map) == nullptr) return;
  Watch& watch = watches_[map];
  if (std::make_pair(epoch, revision) <= std::make_pair(watch.epoch, watch.revision)) return;
  watch.epoch = epoch;
  watch.revision = revision;
}

std::vector<MapDelta> ReplicaSet::ApplyPending() {
  std::vector<MapDelta> applied;
  const auto elsewhere = [this](KeyFrameId id) { return FindKeyFrameData(id); };
  for (auto& [id, replica] : replicas_) {
    if (replica.waiting() == 0) continue;
    for (MapDelta& delta : replica.ApplyPending(elsewhere)) applied.push_back(std::move(delta));
  }
  return applied;
}

bool ReplicaSet::IsBehind(const Map& map, const Watch& watch) const {
  return watch.revision > 0 &&
         std::make_pair(map.epoch(), map.revision()) < std::make_pair(watch.epoch, watch.revision);
}

std::vector<SnapshotRequest> ReplicaSet::DueRequests(double now_s, ProcessId asker) {
  std::vector<SnapshotRequest> requests;
  for (const auto& [id, replica] : replicas_) {
    Watch& watch = watches_[id];
    const bool gap = HeldFor(replica.NeedsSnapshot(), 1e-3 * MapReplica::kPatienceMs, now_s, &watch.gap_since);
    const bool behind = HeldFor(IsBehind(replica.map(), watch), kAnnouncedPatienceS, now_s, &watch.behind_since);
    if (!replica.NeedsSnapshot() && !IsBehind(replica.map(), watch)) watch.requests = 0;
    const double interval_s =
        std::min(std::ldexp(kRequestIntervalS, watch.requests / kRequestsBeforeLess), kMaxRequestIntervalS);
    if ((!gap && !behind) || now_s - watch.last_request_s < interval_s) continue;
    watch.last_request_s = now_s;
    watch.requests = std::min(watch.requests + 1, kMaxRequestsCounted);
    requests.push_back(replica.MakeRequest(asker));
  }
  return requests;
}

bool ReplicaSet::IsEmpty(MapId map) const {
  const auto replica = replicas_.find(map);
  const auto watch = watches_.find(map);
  return (replica == replicas_.end() || (replica->second.map().revision() == 0 && replica->second.waiting() == 0)) &&
         (watch == watches_.end() || watch->second.revision == 0);
}

Revision ReplicaSet::Lag(MapId map) const {
  const auto replica = replicas_.find(map);
  const auto watch = watches_.find(map);
  if (replica == replicas_.end() || watch == watches_.end()) return 0;
  const Map& state = replica->second.map();
  return state.epoch() == watch->second.epoch && state.revision() < watch->second.revision
             ? watch->second.revision - state.revision()
             : 0;
}

bool ReplicaSet::IsBehind(MapId map) const {
  const auto replica = replicas_.find(map);
  const auto watch = watches_.find(map);
  return replica != replicas_.end() && watch != watches_.end() && IsBehind(replica->second.map(), watch->second);
}

MapReplica::Counters ReplicaSet::counters() const {
  MapReplica::Counters sum = other_counters_;
  for (const auto& [id, replica] : replicas_) Add(replica.counters(), &sum);
  return sum;
}

}  // namespace portolan
