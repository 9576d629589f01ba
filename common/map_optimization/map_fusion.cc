#include "map_optimization/map_fusion.h"

#include <algorithm>
#include <optional>
#include <string>

#include "base/time.h"
#include "map_optimization/correction_steps.h"
#include "map_optimization/map_correction.h"

namespace portolan {
namespace {

using Edge = std::pair<KeyFrameId, KeyFrameId>;  // keyframe of the other map, of the map

/// Ids are unique in a deployment: an element of both maps is an error of whoever made them.
Status CheckDistinct(const Map& map, const Map& other) {
  const std::string maps = " is in map " + ToString(map.id()) + " and in map " + ToString(other.id());
  if (map.id() == other.id()) return Error{"fusion of map " + ToString(map.id()) + " with itself"};
  for (const auto& [id, keyframe] : other.keyframes()) {
    if (map.FindKeyFrame(id) != nullptr) return Error{"fusion: keyframe " + ToString(id) + maps};
  }
  for (const auto& [id, point] : other.points()) {
    if (map.FindPoint(id) != nullptr) return Error{"fusion: point " + ToString(id) + maps};
  }
  return Ok{};
}

Status CheckOverlap(const Map& map, const Map& other, const LoopClosure& overlap) {
  const auto missing = [](KeyFrameId id, const Map& in) {
    return Error{"fusion: keyframe " + ToString(id) + " is not in map " + ToString(in.id())};
  };
  if (other.FindKeyFrame(overlap.current) == nullptr) return missing(overlap.current, other);
  if (map.FindKeyFrame(overlap.matched) == nullptr) return missing(overlap.matched, map);
  if (!IsSimilarity(overlap.current_from_matched)) {
    return Error{"fusion: current_from_matched is no similarity, scale " + std::to_string(overlap.current_from_matched.scale)};
  }
  return CheckDistinct(map, other);
}

/// Hangs the other map's tree, which is in `map` already, below a keyframe of the map, turned so that it begins at the edge.
void HangTree(const Map& other, const Edge& edge, Map* map) {
  for (const auto& [id, keyframe] : other.keyframes()) {
    if (keyframe.parent.IsValid()) map->SetParent(id, keyframe.parent);
  }
  KeyFrameId parent = edge.second;
  for (KeyFrameId id = edge.first; id.IsValid(); id = other.keyframe(id).parent) {
    map->SetParent(id, parent);
    parent = id;
  }
}

/// Adds all of the other map, moved, as it is: nothing merged yet.
void TakeIn(const Map& other, const MovedMap& moved, const Edge& edge, Map* map) {
  for (const auto& [id, camera_from_map] : moved.poses) map->AddKeyFrame(other.keyframe(id).data, camera_from_map, KeyFrameId());
  HangTree(other, edge, map);
  for (const auto& [id, position] : moved.points) {
    map->AddPoint(id, position);
    for (const Observation& o : other.point(id).observations) map->AddObservation(id, o.keyframe, o.feature);
  }
}

std::optional<Edge> FindEdge(const MapCorrection& correction, const Map& other, const Map& map) {
  for (const Edge& edge : correction.loop_edges) {
    if (other.FindKeyFrame(edge.first) != nullptr && map.FindKeyFrame(edge.second) != nullptr) return edge;
  }
  return std::nullopt;
}

Status CheckFusion(const MapCorrection& correction, const Map& other, const Map& map) {
  const std::string name = NameOf(correction);
  if (correction.kind != "fusion") return Error{name + ": expected a fusion"};
  if (Status checked = CheckCorrection(correction, map); !checked.ok()) return checked;
  if (correction.other != other.id()) return Error{name + ": takes in " + ToString(correction.other) + ", the other map here is " + ToString(other.id())};
  if (!IsSimilarity(correction.map_from_other)) {
    return Error{name + ": map_from_other is no similarity, scale " + std::to_string(correction.map_from_other.scale)};
  }
  if (other.keyframes().empty()) return Error{name + ": map " + ToString(other.id()) + " is empty"};
  return CheckDistinct(map, other);
}

}  // namespace

Sim3d MapFromOther(const Map& map, const Map& other, const LoopClosure& overlap) {
  return Sim3d(map.keyframe(overlap.matched).camera_from_map).Inverse() * overlap.current_from_matched.Inverse() *
         Sim3d(other.keyframe(overlap.current).camera_from_map);
}

Result<MapCorrection> ProposeFusion(const Map& map, const Map& other, const LoopClosure& overlap, const LoopCorrectionOptions& options,
                                    const std::atomic<bool>* stop, StageTimes* times) {
  if (Status checked = CheckOverlap(map, other, overlap); !checked.ok()) return checked.error();
  const Stopwatch watch;
  const Sim3d map_from_other = MapFromOther(map, other, overlap);
  Map joined = map;
  TakeIn(other, MoveMap(MapCorrection(), other, map_from_other), {overlap.current, overlap.matched}, &joined);
  joined.RefreshDerived();
  if (times != nullptr) times->Add("fusion_join", watch.Milliseconds());

  // In the joined map the two keyframes lie to each other as the overlap says: a loop without a gap, yet to be welded.
  LoopClosure loop = overlap;
  loop.current_from_matched =
      Sim3d(joined.keyframe(overlap.current).camera_from_map * joined.keyframe(overlap.matched).camera_from_map.Inverse());
  CorrectionFrame frame;
  frame.kind = "fusion";
  for (const auto& [id, keyframe] : map.keyframes()) frame.held.insert(id);
  Result<MapCorrection> correction = CorrectLoop(joined, loop, frame, options, stop, times);
  if (!correction.ok()) return correction;
  correction->other = other.id();
  correction->map_from_other = map_from_other;
  const Sim3d other_units_from_map_units(1 / map_from_other.scale, Eigen::Quaterniond::Identity(), Eigen::Vector3d::Zero());
  for (auto& keyframe : correction->keyframes) keyframe.camera_from_map = other_units_from_map_units * keyframe.camera_from_map;
  return correction;
}

Result<std::vector<std::pair<MapPointId, MapPointId>>> ApplyFusion(const MapCorrection& correction, const Map& other, Map* map) {
  if (Status checked = CheckFusion(correction, other, *map); !checked.ok()) return checked.error();
  const std::optional<Edge> edge = FindEdge(correction, other, *map);
  if (!edge) {
    return Error{NameOf(correction) + ": none of its " + std::to_string(correction.loop_edges.size()) + " loop edges joins what the maps hold now"};
  }
  TakeIn(other, MoveMap(correction, other, correction.map_from_other), *edge, map);
  for (const auto& [id, position] : correction.points) {  // landmarks of the map, which the weld moved too
    if (other.FindPoint(id) == nullptr && map->FindPoint(id) != nullptr) map->SetPosition(id, position);
  }
  auto merged = JoinLandmarks(correction, map);
  map->RefreshDerived();
  return merged;
}

}  // namespace portolan
