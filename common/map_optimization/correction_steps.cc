#include "map_optimization/correction_steps.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <unordered_map>

#include "map/delta_check.h"

namespace portolan {
namespace {

/// What the correction does to a keyframe.
struct CorrectedKeyFrame {
  Sim3d camera_from_map;  // given, or that of the nearest corrected ancestor and the unchanged relative pose
  Sim3d new_from_old;     // of the map around it: what points do that follow it
  Eigen::Vector3d old_centre;
};

using CorrectedKeyFrames = std::unordered_map<KeyFrameId, CorrectedKeyFrame>;

/// None where all of the correction is younger.
std::optional<Sim3d> FindCorrected(const Map& map, const std::unordered_map<KeyFrameId, Sim3d>& given, KeyFrameId id) {
  for (KeyFrameId ancestor = id; ancestor.IsValid(); ancestor = map.keyframe(ancestor).parent) {
    const auto found = given.find(ancestor);
    if (found == given.end()) continue;
    if (ancestor == id) return found->second;
    const Rigid3d own_from_ancestor =
        map.keyframe(id).camera_from_map * map.keyframe(ancestor).camera_from_map.Inverse();
    return Sim3d(own_from_ancestor) * found->second;
  }
  return std::nullopt;
}

CorrectedKeyFrames CorrectKeyFrames(const MapCorrection& correction, const Map& map, const Sim3d& new_from_old) {
  std::unordered_map<KeyFrameId, Sim3d> given;
  for (const auto& keyframe : correction.keyframes) given.emplace(keyframe.id, keyframe.camera_from_map);
  CorrectedKeyFrames corrected;
  for (const auto& [id, keyframe] : map.keyframes()) {
    const Sim3d old(keyframe.camera_from_map);
    const Eigen::Vector3d old_centre = keyframe.camera_from_map.TargetOriginInSource();
    if (const std::optional<Sim3d> camera_from_map = FindCorrected(map, given, id)) {
      corrected.emplace(id, CorrectedKeyFrame{*camera_from_map, camera_from_map->Inverse() * old, old_centre});
    } else {
      corrected.emplace(id, CorrectedKeyFrame{old * new_from_old.Inverse(), new_from_old, old_centre});
    }
  }
  return corrected;
}

/// The keyframe that sees the point from nearest: what it is off in position shows least there.
const CorrectedKeyFrame& NearestObserver(const CorrectedKeyFrames& corrected, const MapPoint& point) {
  const Eigen::Vector3d position = point.position_in_map.cast<double>();
  const CorrectedKeyFrame* nearest = nullptr;
  double least = 0;
  for (const Observation& o : point.observations) {
    const CorrectedKeyFrame& observer = corrected.at(o.keyframe);
    const double distance = (observer.old_centre - position).squaredNorm();
    if (nearest != nullptr && distance >= least) continue;
    nearest = &observer;
    least = distance;
  }
  return *nearest;
}

std::vector<std::pair<MapPointId, Eigen::Vector3f>> CorrectPoints(const MapCorrection& correction, const Map& map,
                                                                  const CorrectedKeyFrames& corrected,
                                                                  const Sim3d& new_from_old) {
  std::unordered_map<MapPointId, Eigen::Vector3f> given;
  for (const auto& point : correction.points) given.emplace(point.id, point.position_in_map);
  std::vector<std::pair<MapPointId, Eigen::Vector3f>> moved;
  moved.reserve(map.points().size());
  for (const auto& [id, point] : map.points()) {
    const auto found = given.find(id);
    const Sim3d& motion = point.observations.empty() ? new_from_old : NearestObserver(corrected, point).new_from_old;
    const Eigen::Vector3f position =
        found != given.end() ? found->second
                             : Eigen::Vector3f((motion * point.position_in_map.cast<double>()).cast<float>());
    if (position.allFinite()) moved.emplace_back(id, position);
  }
  std::sort(moved.begin(), moved.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  return moved;
}

}  // namespace

std::string NameOf(const MapCorrection& correction) {
  return "correction " + std::to_string(correction.number) + " (" + correction.kind + ") of " +
         ToString(correction.map);
}

bool IsSimilarity(const Sim3d& s) {
  return std::isfinite(s.scale) && s.scale > 0 && s.rotation.coeffs().allFinite() && s.translation.allFinite();
}

Status CheckCorrection(const MapCorrection& correction, const Map& map) {
  const std::string name = NameOf(correction);
  if (correction.map != map.id()) return Error{name + ": the map here is " + ToString(map.id())};
  if (correction.epoch != map.epoch()) {
    return Error{name + ": made in epoch " + std::to_string(correction.epoch) + ", now it is " +
                 std::to_string(map.epoch())};
  }
  if (correction.made_from_revision > map.revision()) {
    return Error{name + ": made from revision " + std::to_string(correction.made_from_revision) + ", the map is at " +
                 std::to_string(map.revision())};
  }
  for (const auto& keyframe : correction.keyframes) {
    if (IsSimilarity(keyframe.camera_from_map)) continue;
    return Error{name + ": keyframe " + ToString(keyframe.id) + " has a pose that is not a similarity, scale " +
                 std::to_string(keyframe.camera_from_map.scale)};
  }
  for (const auto& point : correction.points) {
    if (!IsSoundPosition(point.position_in_map))
      return Error{name + ": point " + ToString(point.id) + " is not finite, or beyond any map"};
  }
  return Ok{};
}

MovedMap MoveMap(const MapCorrection& correction, const Map& map, const Sim3d& new_from_old) {
  const CorrectedKeyFrames corrected = CorrectKeyFrames(correction, map, new_from_old);
  MovedMap moved;
  for (const auto& [id, keyframe] : map.keyframes())
    moved.poses.emplace_back(id, MakeRigid(corrected.at(id).camera_from_map));
  moved.points = CorrectPoints(correction, map, corrected, new_from_old);
  return moved;
}

Status CheckMoved(const MapCorrection& correction, const MovedMap& moved) {
  for (const auto& [id, camera_from_map] : moved.poses) {
    if (!IsSoundPose(camera_from_map))
      return Error{NameOf(correction) + ": keyframe " + ToString(id) + " would come to lie beyond any map"};
  }
  for (const auto& [id, position] : moved.points) {
    if (!IsSoundPosition(position))
      return Error{NameOf(correction) + ": point " + ToString(id) + " would come to lie beyond any map"};
  }
  for (const auto& [id, position] : correction.points) {  // of a fusion some are landmarks of the map that stays
    if (!IsSoundPosition(position))
      return Error{NameOf(correction) + ": point " + ToString(id) + " would come to lie beyond any map"};
  }
  return Ok{};
}

std::vector<std::pair<MapPointId, MapPointId>> JoinLandmarks(const MapCorrection& correction, Map* map) {
  std::vector<std::pair<MapPointId, MapPointId>> merged;
  for (const auto& [from, into] : correction.merges) {
    if (from == into || map->FindPoint(from) == nullptr || map->FindPoint(into) == nullptr) continue;
    map->MergePoints(from, into);
    merged.emplace_back(from, into);
  }
  for (const auto& [point, observation] : correction.observations) {
    const KeyFrame* keyframe = map->FindKeyFrame(observation.keyframe);
    if (keyframe == nullptr || observation.feature >= keyframe->landmarks.num_features()) continue;
    if (map->FindPoint(point) != nullptr) map->AddObservation(point, observation.keyframe, observation.feature);
  }
  return merged;
}

}  // namespace portolan
