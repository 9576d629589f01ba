#include "mapping/correction.h"

#include <cmath>
#include <map>
#include <string>
#include <unordered_map>

#include "geometry/sim3.h"

namespace portolan {
namespace {

Status CheckFits(const MapCorrection& correction, const Map& map) {
  const std::string name =
      "correction " + std::to_string(correction.number) + " (" + correction.kind + ") of " + ToString(correction.map);
  if (correction.map != map.id()) return Error{name + ": the map here is " + ToString(map.id())};
  if (correction.epoch != map.epoch()) {
    return Error{name + ": made in epoch " + std::to_string(correction.epoch) + ", now it is " +
                 std::to_string(map.epoch())};
  }
  if (correction.made_from_revision > map.revision()) {
    return Error{name + ": made from revision " + std::to_string(correction.made_from_revision) + ", the map is at " +
                 std::to_string(map.revision())};
  }
  bool any = false;
  for (const auto& keyframe : correction.keyframes) {
    const Sim3d& s = keyframe.camera_from_map;
    if (!std::isfinite(s.scale) || !(s.scale > 0) || !s.rotation.coeffs().allFinite() || !s.translation.allFinite()) {
      return Error{name + ": keyframe " + ToString(keyframe.id) + " has a pose that is not a similarity, scale " +
                   std::to_string(s.scale)};
    }
    any = any || map.FindKeyFrame(keyframe.id) != nullptr;
  }
  for (const auto& point : correction.points) {
    if (!point.position_in_map.allFinite()) return Error{name + ": point " + ToString(point.id) + " is not finite"};
  }
  if (!any)
    return Error{name + ": none of its " + std::to_string(correction.keyframes.size()) + " keyframes is in the map"};
  return Ok{};
}

/// Corrected camera_from_map of every keyframe: given, or that of the nearest corrected ancestor followed by the
/// unchanged relative pose.
class CorrectedPoses {
 public:
  CorrectedPoses(const MapCorrection& correction, const Map& map) : map_(map) {
    for (const auto& keyframe : correction.keyframes) {
      if (map.FindKeyFrame(keyframe.id) != nullptr) corrected_.emplace(keyframe.id, keyframe.camera_from_map);
    }
  }

  Sim3d Find(KeyFrameId id) const {
    for (KeyFrameId ancestor = id; ancestor.IsValid(); ancestor = map_.keyframe(ancestor).parent) {
      const auto found = corrected_.find(ancestor);
      if (found == corrected_.end()) continue;
      if (ancestor == id) return found->second;
      const Rigid3d own_from_ancestor =
          map_.keyframe(id).camera_from_map * map_.keyframe(ancestor).camera_from_map.Inverse();
      return Sim3d(own_from_ancestor) * found->second;
    }
    return Sim3d(map_.keyframe(id).camera_from_map);  // older than all of the correction: it stays
  }

 private:
  const Map& map_;
  std::unordered_map<KeyFrameId, Sim3d> corrected_;
};

/// The same pose as a rigid motion: [R t/s] (paper Eq. 13).
Rigid3d MakeRigid(const Sim3d& camera_from_map) {
  return Rigid3d(camera_from_map.rotation.normalized(), camera_from_map.translation / camera_from_map.scale);
}

std::vector<std::pair<MapPointId, MapPointId>> MergeAll(const MapCorrection& correction, Map* map) {
  std::vector<std::pair<MapPointId, MapPointId>> merged;
  for (const auto& [from, into] : correction.merges) {
    if (from == into || map->FindPoint(from) == nullptr || map->FindPoint(into) == nullptr) continue;
    map->MergePoints(from, into);
    merged.emplace_back(from, into);
  }
  return merged;
}

}  // namespace

Result<std::vector<std::pair<MapPointId, MapPointId>>> ApplyMapCorrection(const MapCorrection& correction, Map* map) {
  if (Status fits = CheckFits(correction, *map); !fits.ok()) return fits.error();
  // All is computed from the map as it is, then changed.
  const CorrectedPoses corrected(correction, *map);
  std::map<KeyFrameId, Sim3d> poses;
  for (const auto& [id, keyframe] : map->keyframes()) poses.emplace(id, corrected.Find(id));
  std::unordered_map<MapPointId, Eigen::Vector3f> given;
  for (const auto& point : correction.points) given.emplace(point.id, point.position_in_map);
  std::vector<std::pair<MapPointId, Eigen::Vector3f>> positions;
  for (const MapPointId id : map->SortedPointIds()) {
    const MapPoint& point = map->point(id);
    if (const auto found = given.find(id); found != given.end()) {
      positions.emplace_back(id, found->second);
    } else if (!point.observations.empty()) {
      const KeyFrameId observer = point.observations.front().keyframe;
      const Eigen::Vector3d in_camera = map->keyframe(observer).camera_from_map * point.position_in_map.cast<double>();
      positions.emplace_back(id, (poses.at(observer).Inverse() * in_camera).cast<float>());
    }
  }
  for (const auto& [id, pose] : poses) map->SetPose(id, MakeRigid(pose));
  for (const auto& [id, position] : positions) map->SetPosition(id, position);
  auto merged = MergeAll(correction, map);
  map->RefreshDerived();
  return merged;
}

}  // namespace portolan
