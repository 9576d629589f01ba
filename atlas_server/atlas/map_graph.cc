#include "atlas/map_graph.h"

#include <algorithm>
#include <cmath>
#include <deque>

namespace portolan {
namespace {

/// Seen from its other end.
MapGraph::Link Turned(const MapGraph::Link& link) {
  return {link.other, link.map, link.map_from_other.Inverse(), link.origin};
}

}  // namespace

bool IsValidSimilarity(const Sim3d& similarity) {
  return similarity.translation.allFinite() && similarity.rotation.coeffs().allFinite() &&
         std::isfinite(similarity.scale) && similarity.scale > 0 && std::abs(similarity.rotation.norm() - 1) < 1e-3;
}

MapGraph::MapGraph(const State& state) {
  for (const Fused& fused : state.fused) {
    if (fused.map != fused.other && fused.map.IsValid() && IsValidSimilarity(fused.map_from_other))
      fused_[fused.other] = fused;
  }
  for (auto next = fused_.begin(); next != fused_.end();)
    next = fused_.count(next->second.map) == 1 ? fused_.erase(next)
                                               : std::next(next);  // a chain is no state of this class
  for (const auto& [other, fused] : fused_) AddMap(fused.map);
  for (const MapId map : state.maps) AddMap(map);
  for (const Link& link : state.links) {
    if (fused_.count(link.map) == 0 && fused_.count(link.other) == 0) SetLink(link);
  }
  for (const Activity& activity : state.activities) {
    if (activity.map == activity.other || fused_.count(activity.map) == 1 || fused_.count(activity.other) == 1)
      continue;
    AddMap(activity.map);
    AddMap(activity.other);
    activities_[PairOf(activity.map, activity.other)] = activity.count;
  }
}

MapGraph::State MapGraph::state() const {
  State state;
  state.maps.assign(maps_.begin(), maps_.end());
  for (const auto& [pair, link] : links_) state.links.push_back(link);
  for (const auto& [pair, count] : activities_) state.activities.push_back({pair.first, pair.second, count});
  for (const auto& [other, fused] : fused_) state.fused.push_back(fused);
  return state;
}

void MapGraph::AddMap(MapId map) {
  if (map.IsValid() && fused_.count(map) == 0 && maps_.insert(map).second) ++version_;
}

void MapGraph::AddNewMap(MapId map, MapId adjacent) {
  AddMap(map);
  if (!map.IsValid() || !adjacent.IsValid() || map == adjacent || fused_.count(map) == 1 || fused_.count(adjacent) == 1)
    return;
  AddMap(adjacent);
  if (activities_.emplace(PairOf(map, adjacent), 1).second) ++version_;
}

void MapGraph::SetLink(const Link& link) {
  if (!link.map.IsValid() || !link.other.IsValid() || link.map == link.other || !IsValidSimilarity(link.map_from_other))
    return;
  if (fused_.count(link.map) == 1 || fused_.count(link.other) == 1) return;
  AddMap(link.map);
  AddMap(link.other);
  links_[PairOf(link.map, link.other)] = link.map < link.other ? link : Turned(link);
  ++version_;
}

void MapGraph::CountSwitch(MapId map, MapId other) {
  if (!map.IsValid() || !other.IsValid() || map == other || fused_.count(map) == 1 || fused_.count(other) == 1) return;
  AddMap(map);
  AddMap(other);
  ++activities_[PairOf(map, other)];
  ++version_;
}

void MapGraph::Merge(MapId map, MapId other, const Sim3d& map_from_other) {
  if (map == other || !map.IsValid() || !other.IsValid() || !IsValidSimilarity(map_from_other)) return;
  AddMap(map);
  const std::map<Pair, Link> links = links_;
  const std::map<Pair, uint64_t> activities = activities_;
  Remove(other);
  for (const auto& [pair, link] : links) {
    if (pair.first != other && pair.second != other) continue;
    const Link from_other = link.map == other ? link : Turned(link);  // other from third
    if (from_other.other == map || links.count(PairOf(map, from_other.other)) == 1) continue;
    SetLink({map, from_other.other, map_from_other * from_other.map_from_other, link.origin});
  }
  for (const auto& [pair, count] : activities) {
    if (pair.first != other && pair.second != other) continue;
    const MapId third = pair.first == other ? pair.second : pair.first;
    if (third != map) activities_[PairOf(map, third)] += count;
  }
  for (auto& [earlier, fused] : fused_) {
    if (fused.map == other) fused = {map, earlier, map_from_other * fused.map_from_other};
  }
  fused_[other] = {map, other, map_from_other};
  ++version_;
}

void MapGraph::Remove(MapId map) {
  maps_.erase(map);
  const auto forget = [map](auto* by_pair) {
    for (auto next = by_pair->begin(); next != by_pair->end();)
      next = next->first.first == map || next->first.second == map ? by_pair->erase(next) : std::next(next);
  };
  forget(&links_);
  forget(&activities_);
  ++version_;
}

uint64_t MapGraph::ActivityOf(MapId map, MapId other) const {
  const auto found = activities_.find(PairOf(map, other));
  return found == activities_.end() ? 0 : found->second;
}

std::optional<MapGraph::Link> MapGraph::FindLink(MapId map, MapId other) const {
  const auto found = links_.find(PairOf(map, other));
  if (found == links_.end()) return std::nullopt;
  return found->second.map == map ? found->second : Turned(found->second);
}

std::optional<Sim3d> MapGraph::FindWay(MapId map, MapId other) const {
  std::map<MapId, Sim3d> map_from{{map, Sim3d()}};
  std::deque<MapId> next{map};
  while (!next.empty() && map_from.count(other) == 0) {
    const MapId here = next.front();
    next.pop_front();
    for (const MapId neighbour : maps_) {
      const auto link = FindLink(here, neighbour);
      if (!link || map_from.count(neighbour) == 1) continue;
      map_from[neighbour] = map_from.at(here) * link->map_from_other;
      next.push_back(neighbour);
    }
  }
  const auto found = map_from.find(other);
  if (found == map_from.end()) return std::nullopt;
  return found->second;
}

std::vector<MapId> MapGraph::ByActivity(MapId map) const {
  std::vector<MapId> others(maps_.rbegin(), maps_.rend());
  others.erase(std::remove(others.begin(), others.end(), map), others.end());
  std::stable_sort(others.begin(), others.end(),
                   [&](MapId a, MapId b) { return ActivityOf(map, a) > ActivityOf(map, b); });
  return others;
}

std::pair<MapId, Sim3d> MapGraph::Resolve(MapId map) const {
  const auto found = fused_.find(map);
  if (found == fused_.end()) return {map, Sim3d()};
  return {found->second.map, found->second.map_from_other};
}

}  // namespace portolan
