#include "mapping/fused_maps.h"

#include <algorithm>
#include <utility>

namespace portolan {

void FusedMaps::Note(const Map& other, MapId map, const Sim3d& map_from_other) {
  Fused fused{other.id(), map, map_from_other, {}};
  for (const auto& [id, keyframe] : other.keyframes()) fused.poses.emplace(id, keyframe.camera_from_map);
  fused_.push_back(std::move(fused));
  if (fused_.size() > kMaxKept) fused_.pop_front();
}

const FusedMaps::Fused* FusedMaps::Find(MapId other) const {
  const auto found =
      std::find_if(fused_.begin(), fused_.end(), [&](const Fused& fused) { return fused.other == other; });
  return found == fused_.end() ? nullptr : &*found;
}

bool FusedMaps::Redirect(const std::function<const Map*(MapId)>& find, KeyFrameMessage* message) const {
  if (message->kind != KeyFrameKind::kTracked || Find(message->map) == nullptr) return false;
  const Fused& first = *Find(message->map);
  MapId map = first.map;
  Sim3d map_from_other = first.map_from_other;
  for (const Fused* next = Find(map); next != nullptr; next = Find(map)) {
    map = next->map;
    map_from_other = next->map_from_other * map_from_other;
  }
  const auto then = first.poses.find(message->reference);
  const Map* into = find(map);
  const KeyFrame* now = into != nullptr ? into->FindKeyFrame(message->reference) : nullptr;
  if (then != first.poses.end() && now != nullptr) {
    // Welding and what was corrected since moved the reference a little: [s R, s t] of its pose then is that of now.
    const Sim3d map_units(map_from_other.scale, Eigen::Quaterniond::Identity(), Eigen::Vector3d::Zero());
    map_from_other = Sim3d(now->camera_from_map).Inverse() * map_units * Sim3d(then->second);
  }
  message->camera_from_map = TransformPose(message->camera_from_map, map_from_other);
  message->map = map;
  return true;
}

}  // namespace portolan
