#include "mapping/passed_on_maps.h"

#include <algorithm>
#include <utility>

namespace portolan {

void PassedOnMaps::Keep(const Map& map) {
  Forget(map.id());
  Kept kept{map.id(), {}};
  for (const auto& [id, keyframe] : map.keyframes()) kept.keyframes.push_back(keyframe.data);
  kept_.push_back(std::move(kept));
  if (kept_.size() > kMaxMaps) kept_.pop_front();
}

void PassedOnMaps::Return(MapReplica* replica) {
  const MapId map = replica->map().id();
  for (const Kept& kept : kept_) {
    if (kept.map != map) continue;
    for (const auto& data : kept.keyframes) replica->AddKeyFrameData(data);
  }
  Forget(map);
}

void PassedOnMaps::Forget(MapId map) {
  kept_.erase(std::remove_if(kept_.begin(), kept_.end(), [&](const Kept& kept) { return kept.map == map; }),
              kept_.end());
}

}  // namespace portolan
