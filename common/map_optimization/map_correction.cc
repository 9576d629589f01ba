#include "map_optimization/map_correction.h"

#include <algorithm>

#include "map_optimization/correction_steps.h"

namespace portolan {

MapCorrection EmptyCorrection(const Map& map, const std::string& kind) {
  MapCorrection correction;
  correction.map = map.id();
  correction.epoch = map.epoch();
  correction.made_from_revision = map.revision();
  correction.kind = kind;
  return correction;
}

Result<std::vector<std::pair<MapPointId, MapPointId>>> ApplyMapCorrection(const MapCorrection& correction, Map* map) {
  if (Status checked = CheckCorrection(correction, *map); !checked.ok()) return checked.error();
  const bool any = std::any_of(correction.keyframes.begin(), correction.keyframes.end(),
                               [&](const auto& keyframe) { return map->FindKeyFrame(keyframe.id) != nullptr; });
  if (!any) {
    return Error{NameOf(correction) + ": none of its " + std::to_string(correction.keyframes.size()) +
                 " keyframes is in the map"};
  }
  // All is computed from the map as it is, then changed.
  const MovedMap moved = MoveMap(correction, *map, Sim3d());
  if (Status checked = CheckMoved(correction, moved); !checked.ok()) return checked.error();
  for (const auto& [id, camera_from_map] : moved.poses) map->SetPose(id, camera_from_map);
  for (const auto& [id, position] : moved.points) {
    if (position != map->point(id).position_in_map) map->SetPosition(id, position);
  }
  auto merged = JoinLandmarks(correction, map);
  map->RefreshDerived();
  return merged;
}

}  // namespace portolan
