#include "mapping/point_fusion.h"

#include <algorithm>

namespace portolan {
namespace {

/// Neighbours, best first, and after them their neighbours.
std::vector<KeyFrameId> SelectTargets(const Map& map, KeyFrameId keyframe, const FusionOptions& options) {
  std::vector<KeyFrameId> targets;
  const auto add = [&](KeyFrameId id) {
    if (id != keyframe && std::find(targets.begin(), targets.end(), id) == targets.end()) targets.push_back(id);
  };
  const auto neighbours = map.CovisibleKeyFrames(keyframe, 1, static_cast<size_t>(options.neighbours));
  for (const auto& [id, common] : neighbours) add(id);
  for (const auto& [id, common] : neighbours) {
    if (options.second_neighbours == 0) break;
    for (const auto& [second, second_common] :
         map.CovisibleKeyFrames(id, 1, static_cast<size_t>(options.second_neighbours))) {
      add(second);
    }
  }
  if (targets.size() > static_cast<size_t>(options.max_keyframes))
    targets.resize(static_cast<size_t>(options.max_keyframes));
  return targets;
}

}  // namespace

FusionResult FuseWithNeighbours(Map* map, KeyFrameId keyframe, const FusionOptions& options) {
  FusionResult result;
  map->RefreshDerived();
  const std::vector<KeyFrameId> targets = SelectTargets(*map, keyframe, options);
  for (const KeyFrameId target : targets) {
    FuseIntoKeyFrame(map, target, LandmarksOf(*map, {keyframe}), options, &result);
  }
  map->RefreshDerived();
  FuseIntoKeyFrame(map, keyframe, LandmarksOf(*map, targets), options, &result);
  map->RefreshDerived();
  return result;
}

}  // namespace portolan
