#include "map_optimization/map_fusion.h"

#include <algorithm>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "base/time.h"
#include "map/delta_check.h"
#include "map_optimization/correction_steps.h"
#include "map_optimization/map_correction.h"

namespace portolan {
namespace {

// Each some tenths of a second: maps of some hundred keyframes are welded all along.
constexpr int kMaxFurtherWelds = 10;
constexpr double kBesideDepths = 0.3;  // median depths between two cameras that see the same things
constexpr double kBesideRad = 0.5;

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
    return Error{"fusion: current_from_matched is no similarity, scale " +
                 std::to_string(overlap.current_from_matched.scale)};
  }
  if (Status checked = CheckResiduals(map, other); !checked.ok()) return checked;
  return CheckDistinct(map, other);
}

/// Hangs the other map's tree, which is in `map` already, below a keyframe of the map, turned so that it begins at the
/// edge.
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

/// Where the map has none of a camera of which the other knows the residual, data from elsewhere, as it was before,
/// becomes that of the other's replicas.
void TakeResiduals(const Map& other, Map* map) {
  const std::vector<CameraResidual> own = map->residuals();
  for (const CameraResidual& known : other.residuals()) {
    const bool is_known =
        std::any_of(own.begin(), own.end(), [&](const CameraResidual& one) { return one.camera == known.camera; });
    if (!is_known) map->SetResidual(known.camera, known.residual);
  }
}

/// Adds all of the other map, moved, as it is: nothing merged yet.
void TakeIn(const Map& other, const MovedMap& moved, const Edge& edge, Map* map) {
  TakeResiduals(other, map);
  for (const auto& [id, camera_from_map] : moved.poses)
    map->AddKeyFrame(other.keyframe(id).data, camera_from_map, KeyFrameId());
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
  if (correction.other != other.id())
    return Error{name + ": takes in " + ToString(correction.other) + ", the other map here is " + ToString(other.id())};
  if (IsSimilarity(correction.map_from_other) &&
      correction.map_from_other.translation.cwiseAbs().maxCoeff() > kMaxCoordinate)
    return Error{name + ": map_from_other leads beyond any map"};
  if (!IsSimilarity(correction.map_from_other)) {
    return Error{name + ": map_from_other is no similarity, scale " + std::to_string(correction.map_from_other.scale)};
  }
  if (other.keyframes().empty()) return Error{name + ": map " + ToString(other.id()) + " is empty"};
  if (Status checked = CheckResiduals(map, other); !checked.ok()) return checked;
  return CheckDistinct(map, other);
}

/// The steps of ProposeFusion, on a copy of the map with all of the other in it.
class FusionProposer {
 public:
  FusionProposer(const Map& map, const Map& other, const LoopClosure& overlap, const LoopCorrectionOptions& options)
      : map_(map), other_(other), options_(options), joined_(map), fusion_(EmptyCorrection(map, "fusion")) {
    fusion_.other = other.id();
    fusion_.map_from_other = MapFromOther(map, other, overlap);
    TakeIn(other, MoveMap(MapCorrection(), other, fusion_.map_from_other), {overlap.current, overlap.matched},
           &joined_);
    joined_.RefreshDerived();
    frame_.kind = "fusion";
    for (const auto& [id, keyframe] : map.keyframes()) frame_.held.insert(id);
    for (const auto& [id, keyframe] : other.keyframes()) scales_[id] = 1 / fusion_.map_from_other.scale;
  }

  /// In the joined map the two keyframes lie to each other as the overlap says: a loop without a gap, yet to be welded.
  Status Weld(const LoopClosure& overlap, const std::atomic<bool>* stop, StageTimes* times);
  /// A keyframe of the other map that lies beside one of the map, sees nothing in common with it yet, and hangs on some
  /// that do.
  std::optional<LoopClosure> FindFurther();
  MapCorrection Take() &&;

 private:
  Rigid3d PoseInJoined(KeyFrameId id) const { return joined_.keyframe(id).camera_from_map; }
  bool IsWelded(KeyFrameId id) const;
  KeyFrameId FindBeside(KeyFrameId id) const;

  const Map& map_;
  const Map& other_;
  const LoopCorrectionOptions& options_;
  Map joined_;
  CorrectionFrame frame_;
  std::map<KeyFrameId, double> scales_;  // units that a keyframe has in the other map, for one of the joined map
  std::set<KeyFrameId> tried_;
  MapCorrection fusion_;
};

Status FusionProposer::Weld(const LoopClosure& overlap, const std::atomic<bool>* stop, StageTimes* times) {
  tried_.insert(overlap.current);
  LoopClosure loop = overlap;
  loop.current_from_matched = Sim3d(PoseInJoined(overlap.current) * PoseInJoined(overlap.matched).Inverse());
  loop.earlier_edges.insert(loop.earlier_edges.end(), fusion_.loop_edges.begin(), fusion_.loop_edges.end());
  Result<MapCorrection> correction = CorrectLoop(joined_, loop, frame_, options_, stop, times);
  if (!correction.ok()) return correction.error();
  if (const auto applied = ApplyMapCorrection(*correction, &joined_); !applied.ok()) return applied.error();
  for (const auto& keyframe : correction->keyframes) scales_[keyframe.id] *= keyframe.camera_from_map.scale;
  const auto append = [](const auto& from, auto* to) { to->insert(to->end(), from.begin(), from.end()); };
  append(correction->merges, &fusion_.merges);
  append(correction->observations, &fusion_.observations);
  append(correction->loop_edges, &fusion_.loop_edges);
  return Ok{};
}

bool FusionProposer::IsWelded(KeyFrameId id) const {
  for (const auto& [neighbour, common] : joined_.CovisibleKeyFrames(id, options_.min_loop_common)) {
    if (frame_.held.count(neighbour) == 1) return true;
  }
  return false;
}

/// The nearest keyframe of the map that looks the same way, from as near that it should see the same things; none if
/// none does.
KeyFrameId FusionProposer::FindBeside(KeyFrameId id) const {
  const Rigid3d own = PoseInJoined(id);
  KeyFrameId nearest;
  double least = kBesideDepths * joined_.MedianDepth(id);
  for (const auto& [candidate, keyframe] : map_.keyframes()) {
    const double distance = (keyframe.camera_from_map.TargetOriginInSource() - own.TargetOriginInSource()).norm();
    if (distance >= least || keyframe.camera_from_map.rotation.angularDistance(own.rotation) > kBesideRad) continue;
    nearest = candidate;
    least = distance;
  }
  return nearest;
}

std::optional<LoopClosure> FusionProposer::FindFurther() {
  std::optional<LoopClosure> best;
  int most = 0;
  for (const auto& [id, keyframe] : other_.keyframes()) {
    if (tried_.count(id) == 1 || IsWelded(id)) continue;
    int welded = 0;  // of its neighbours: drift from there is small
    for (const auto& [neighbour, common] : joined_.CovisibleKeyFrames(id, options_.min_common)) {
      if (frame_.held.count(neighbour) == 0 && IsWelded(neighbour)) welded += common;
    }
    if (welded <= most) continue;
    const KeyFrameId beside = FindBeside(id);
    if (!beside.IsValid()) continue;
    best.emplace();
    best->current = id;
    best->matched = beside;
    most = welded;
  }
  return best;
}

/// Keyframes and points where they have come to lie.
MapCorrection FusionProposer::Take() && {
  for (const auto& [id, scale] : scales_) {
    const Rigid3d pose = PoseInJoined(id);
    fusion_.keyframes.push_back({id, Sim3d(scale, pose.rotation, scale * pose.translation)});
  }
  for (const MapPointId id : joined_.SortedPointIds()) {
    const MapPoint& point = joined_.point(id);
    const MapPoint* before = map_.FindPoint(id);
    if (before == nullptr || before->position_in_map != point.position_in_map)
      fusion_.points.push_back({id, point.position_in_map});
  }
  return std::move(fusion_);
}

}  // namespace

Sim3d MapFromOther(const Map& map, const Map& other, const LoopClosure& overlap) {
  return Sim3d(map.keyframe(overlap.matched).camera_from_map).Inverse() * overlap.current_from_matched.Inverse() *
         Sim3d(other.keyframe(overlap.current).camera_from_map);
}

Status CheckResiduals(const Map& map, const Map& other) {
  std::vector<CameraResidual> seen;
  for (const Map* one : {&map, &other}) {
    for (const auto& [id, keyframe] : one->keyframes()) {
      const CameraResidual taken_out{keyframe.data->camera, keyframe.data->residual};
      const auto same = std::find_if(seen.begin(), seen.end(),
                                     [&](const CameraResidual& before) { return before.camera == taken_out.camera; });
      if (same == seen.end()) {
        seen.push_back(taken_out);
      } else if (!(*same == taken_out)) {
        return Error{"fusion of map " + ToString(other.id()) + " into map " + ToString(map.id()) + ": keyframe " +
                     ToString(id) + " has another residual of its camera taken out than those before it"};
      }
    }
  }
  return Ok{};
}

Result<MapCorrection> ProposeFusion(const Map& map, const Map& other, const LoopClosure& overlap,
                                    const LoopCorrectionOptions& options, const std::atomic<bool>* stop,
                                    StageTimes* times) {
  if (Status checked = CheckOverlap(map, other, overlap); !checked.ok()) return checked.error();
  const Stopwatch watch;
  FusionProposer proposer(map, other, overlap, options);
  if (times != nullptr) times->Add("fusion_join", watch.Milliseconds());
  if (Status welded = proposer.Weld(overlap, stop, times); !welded.ok()) return welded.error();
  // Where the maps run side by side for longer than the window, they are welded on and on from there.
  for (int more = 0; more < kMaxFurtherWelds; ++more) {
    const std::optional<LoopClosure> further = proposer.FindFurther();
    if (!further) break;
    // A place that can't be welded stays as the pose graph put it.
    static_cast<void>(proposer.Weld(*further, stop, times));
  }
  if (stop != nullptr && stop->load(std::memory_order_relaxed)) return Error{"fusion: interrupted"};
  return std::move(proposer).Take();
}

Result<std::vector<std::pair<MapPointId, MapPointId>>> ApplyFusion(const MapCorrection& correction, const Map& other,
                                                                   Map* map) {
  if (Status checked = CheckFusion(correction, other, *map); !checked.ok()) return checked.error();
  const std::optional<Edge> edge = FindEdge(correction, other, *map);
  if (!edge) {
    return Error{NameOf(correction) + ": none of its " + std::to_string(correction.loop_edges.size()) +
                 " loop edges joins what the maps hold now"};
  }
  const MovedMap moved = MoveMap(correction, other, correction.map_from_other);
  if (Status checked = CheckMoved(correction, moved); !checked.ok()) return checked.error();
  TakeIn(other, moved, *edge, map);
  for (const auto& [id, position] : correction.points) {  // landmarks of the map, which the weld moved too
    if (other.FindPoint(id) == nullptr && map->FindPoint(id) != nullptr) map->SetPosition(id, position);
  }
  auto merged = JoinLandmarks(correction, map);
  map->RefreshDerived();
  return merged;
}

}  // namespace portolan
