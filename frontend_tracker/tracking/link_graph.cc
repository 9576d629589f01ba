#include "tracking/link_graph.h"

#include <algorithm>
#include <deque>
#include <tuple>

namespace portolan {

MapMotion LinkGraph::MotionAt(const Place& place) const {
  const Map* map = find_map_(place.map);
  return map == nullptr ? MapMotion() : MapMotion(*map, place.keyframe);
}

Sim3d LinkGraph::MotionOf(MapId id, const MapMotion& motion) const {
  const Map* map = find_map_(id);
  return map == nullptr ? Sim3d() : motion.Measure(*map).value_or(Sim3d());
}

void LinkGraph::Link(const Place& map, const Place& other, const Sim3d& map_from_other) {
  if (map.map == other.map) return;
  const bool in_order = map.map < other.map;
  Edge edge;
  edge.first_from_second = in_order ? map_from_other : map_from_other.Inverse();
  edge.motion_of_first = MotionAt(in_order ? map : other);
  edge.motion_of_second = MotionAt(in_order ? other : map);
  links_.insert_or_assign(Key(map.map, other.map), std::move(edge));
}

Sim3d LinkGraph::FirstFromSecond(const Pair& maps, const Edge& edge) const {
  return MotionOf(maps.first, edge.motion_of_first) * edge.first_from_second *
         MotionOf(maps.second, edge.motion_of_second).Inverse();
}

void LinkGraph::Fuse(MapId map, MapId other, const Sim3d& map_from_other) {
  for (auto next = links_.begin(); next != links_.end();) {
    const auto& [maps, edge] = *next;
    if (maps.first != other && maps.second != other) {
      ++next;
      continue;
    }
    const MapId third = maps.first == other ? maps.second : maps.first;
    const Sim3d now = FirstFromSecond(maps, edge);
    const Sim3d other_from_third = maps.first == other ? now : now.Inverse();
    const Place place{map, (maps.first == other ? edge.motion_of_first : edge.motion_of_second).keyframe()};
    const Place third_place{third, (maps.first == other ? edge.motion_of_second : edge.motion_of_first).keyframe()};
    next = links_.erase(next);
    if (third != map && !AreLinked(map, third)) Link(place, third_place, map_from_other * other_from_third);
  }
  Link({map, KeyFrameId()}, {other, KeyFrameId()}, map_from_other);  // for those who still speak of it
}

void LinkGraph::Forget(MapId map) {
  for (auto next = links_.begin(); next != links_.end();) {
    const bool names = next->first.first == map || next->first.second == map;
    next = names ? links_.erase(next) : std::next(next);
  }
}

std::map<MapId, std::pair<MapId, int>> LinkGraph::Search(MapId from) const {
  std::map<MapId, std::pair<MapId, int>> reached{{from, {MapId(), 0}}};
  std::deque<MapId> queue{from};
  while (!queue.empty()) {
    const MapId map = queue.front();
    queue.pop_front();
    const int links = reached.at(map).second + 1;
    for (const auto& [maps, edge] : links_) {
      if (maps.first != map && maps.second != map) continue;
      const MapId next = maps.first == map ? maps.second : maps.first;
      if (reached.emplace(next, std::make_pair(map, links)).second) queue.push_back(next);
    }
  }
  return reached;
}

std::optional<Sim3d> LinkGraph::Find(MapId target, MapId source) const {
  const auto reached = Search(target);
  if (reached.count(source) == 0) return std::nullopt;
  Sim3d target_from_source;
  for (MapId map = source; map != target;) {
    const MapId next = reached.at(map).first;
    const Pair key = Key(next, map);
    const Sim3d first_from_second = FirstFromSecond(key, links_.at(key));
    target_from_source = (key.first == next ? first_from_second : first_from_second.Inverse()) * target_from_source;
    map = next;
  }
  return target_from_source;
}

std::vector<MapId> LinkGraph::Reachable(MapId from, int max_links) const {
  std::vector<std::tuple<int, int, MapId>> order;
  for (const auto& [map, way] : Search(from)) {
    if (map != from && way.second <= max_links) order.emplace_back(-Activity(from, map), way.second, map);
  }
  std::sort(order.begin(), order.end());
  std::vector<MapId> maps;
  for (const auto& entry : order) maps.push_back(std::get<2>(entry));
  return maps;
}

int LinkGraph::Activity(MapId a, MapId b) const {
  const auto found = activity_.find(Key(a, b));
  return found == activity_.end() ? 0 : found->second;
}

}  // namespace portolan
