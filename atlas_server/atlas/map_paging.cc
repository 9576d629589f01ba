// Maps of the shelf that are not in memory: what is told of them, and how they go and come back.

#include <spdlog/spdlog.h>

#include <algorithm>
#include <tuple>
#include <utility>

#include "atlas/map_shelf.h"

namespace portolan {

size_t GeometryBytes(const Map& map) {
  constexpr size_t kKeyFrameBytes = 5000;   // with its place in two tables, and a hundred neighbours or two
  constexpr size_t kFeatureBytes = 9;       // location and octave
  constexpr size_t kPointBytes = 180;       // in a table
  constexpr size_t kObservationBytes = 36;  // on both sides, with room to grow
  size_t features = 0, observations = 0;
  for (const auto& [id, keyframe] : map.keyframes()) {
    features += keyframe.landmarks.num_features();
    observations += static_cast<size_t>(keyframe.landmarks.end() - keyframe.landmarks.begin());
  }
  return map.keyframes().size() * kKeyFrameBytes + features * kFeatureBytes + map.points().size() * kPointBytes +
         observations * kObservationBytes;
}

const Map* MapShelf::BringIn(MapId id) {
  const auto paged = paged_.find(id);
  if (paged != paged_.end()) {
    if (paged->second.is_damaged) return nullptr;
    map_loads_left_ = 0;
    Result<MapReplica> replica = ReadReplica(paged->second.held);
    if (!replica) {
      ++map_load_failures_;
      paged->second.is_damaged = true;
      spdlog::error("map {} is not looked at any more: {}", ToString(id), replica.error().message);
      return nullptr;
    }
    ++map_loads_;
    ahead_ += paged->second.held.keyframes;
    replicas_.Put(std::move(*replica));
    paged_.erase(paged);
    last_read_ = id;
  }
  used_[id] = ++uses_;
  return FindMap(id);
}

/// For a candidate in it, which can wait.
const Map* MapShelf::Open(MapId id) {
  const auto paged = paged_.find(id);
  const bool is_to_be_read = paged != paged_.end() && !paged->second.is_damaged;
  if (!is_to_be_read || map_loads_left_ > 0) return BringIn(id);
  came_short_ = true;
  return nullptr;
}

/// With all descriptors at first, of which the points take theirs.
Result<MapReplica> MapShelf::ReadReplica(const HeldMap& held) {
  Result<MapDelta> state = load_state_(held.map);
  if (!state) return state.error();
  if (std::tie(state->epoch, state->revision) != std::tie(held.epoch, held.revision))
    return Error{"the store has another state of it"};
  MapReplica replica(held.map);
  std::vector<KeyFrameId> keyframes;
  for (const auto& keyframe : state->keyframes) {
    Result<KeyFrameData> data = load_(keyframe.id);
    if (!data) return data.error();
    replica.AddKeyFrameData(std::make_shared<const KeyFrameData>(std::move(*data)));
    keyframes.push_back(keyframe.id);
  }
  replica.AddDelta(std::move(*state));
  if (replica.ApplyPending().empty()) return Error{replica.last_problem()};
  for (const KeyFrameId id : keyframes) replica.DropAppearance(id);
  return replica;
}

void MapShelf::Page(MapId id) {
  const MapReplica& replica = maps().at(id);
  Paged& paged = paged_[id];
  paged.held = MeasureMap(replica.map());
  for (const auto& [keyframe, state] : replica.map().keyframes())
    paged.neighbours[keyframe] = *NeighboursIn(replica.map())(keyframe, CandidateOptions().neighbours);
  for (const auto& [keyframe, data] : replica.keyframe_data()) ForgetAppearance(keyframe);
  replicas_.Forget(id);
}

void MapShelf::PageMaps(const MayBePaged& may_be_paged) {
  struct Dormant {
    MapId map;
    uint64_t used = 0;
    size_t bytes = 0;
  };
  std::vector<Dormant> dormant;
  size_t bytes = 0;
  for (const auto& [id, replica] : maps()) {
    if (FindMap(id) == nullptr || replica.waiting() > 0 || replicas_.IsBehind(id) || !may_be_paged(replica.map()))
      continue;
    dormant.push_back({id, used_[id], GeometryBytes(replica.map())});
    bytes += dormant.back().bytes;
  }
  std::sort(dormant.begin(), dormant.end(), [](const Dormant& a, const Dormant& b) { return a.used < b.used; });
  for (const Dormant& unused : dormant) {
    if (1e-6 * static_cast<double>(bytes) <= options_.maps_mb) return;
    if (unused.map == last_read_) continue;
    Page(unused.map);
    bytes -= unused.bytes;
  }
}

/// More of a map is to come. @return false: it is known.
bool MapShelf::ExpectState(MapId id, Epoch epoch, Revision revision) {
  const auto paged = paged_.find(id);
  if (paged == paged_.end()) return true;
  const HeldMap& held = paged->second.held;
  if (std::tie(epoch, revision) <= std::tie(held.epoch, held.revision)) return false;
  if (BringIn(id) == nullptr) ForgetPaged(id);
  return true;
}

/// The replicas learn how far the map was: what is older is not taken for news.
void MapShelf::ForgetPaged(MapId id) {
  const HeldMap held = paged_.at(id).held;
  paged_.erase(id);
  words_.RemovePart(id);
  replicas_.Announce(id, held.epoch, held.revision);
}

std::optional<std::vector<KeyFrameId>> MapShelf::Neighbours(MapId id, KeyFrameId keyframe, size_t most) const {
  if (const Map* map = FindMap(id)) return NeighboursIn(*map)(keyframe, most);
  const auto paged = paged_.find(id);
  if (paged == paged_.end()) return std::nullopt;
  const auto found = paged->second.neighbours.find(keyframe);
  if (found == paged->second.neighbours.end()) return std::nullopt;
  std::vector<KeyFrameId> neighbours = found->second;
  neighbours.resize(std::min(neighbours.size(), most));
  return neighbours;
}

std::optional<MapShelf::Figures> MapShelf::FiguresOf(MapId id) const {
  if (const auto paged = paged_.find(id); paged != paged_.end()) {
    const HeldMap& held = paged->second.held;
    return Figures{held.epoch, held.revision, held.keyframes, held.points, true};
  }
  const auto replica = maps().find(id);
  if (replica == maps().end()) return std::nullopt;
  const Map& map = replica->second.map();
  return Figures{map.epoch(), map.revision(), map.keyframes().size(), map.points().size(), false};
}

std::optional<HeldMap> MapShelf::Measure(MapId id) const {
  if (const auto paged = paged_.find(id); paged != paged_.end()) return paged->second.held;
  const Map* map = FindMap(id);
  return map == nullptr ? std::nullopt : std::optional(MeasureMap(*map));
}

std::vector<MapId> MapShelf::Ids() const {
  std::vector<MapId> ids;
  for (const auto& [id, paged] : paged_) ids.push_back(id);
  for (const auto& [id, replica] : maps()) {
    if (FindMap(id) != nullptr) ids.push_back(id);
  }
  std::sort(ids.begin(), ids.end());
  return ids;
}

}  // namespace portolan
