#include "place_recognition/neighbourhood.h"

#include <algorithm>

namespace portolan {
namespace {

std::vector<KeyFrameId> SelectKeyFrames(const Map& map, KeyFrameId keyframe, const NeighbourhoodOptions& options) {
  std::vector<KeyFrameId> selected{keyframe};
  const auto add = [&](KeyFrameId id) {
    const bool is_new = std::find(selected.begin(), selected.end(), id) == selected.end();
    if (is_new && selected.size() < options.most) selected.push_back(id);
  };
  const auto neighbours = map.CovisibleKeyFrames(keyframe, 1, options.neighbours);
  if (options.neighbours == 0) return selected;  // 0 asks the map for all
  for (const auto& [id, common] : neighbours) add(id);
  if (options.second_neighbours == 0) return selected;
  for (const auto& [id, common] : neighbours) {
    for (const auto& [second, second_common] : map.CovisibleKeyFrames(id, 1, options.second_neighbours)) add(second);
  }
  return selected;
}

}  // namespace

Neighbourhood::Neighbourhood(const Map& map, KeyFrameId keyframe, const NeighbourhoodOptions& options) {
  for (const KeyFrameId id : SelectKeyFrames(map, keyframe, options)) {
    keyframes.push_back(&map.keyframe(id));
    for (const MapPointId landmark : keyframes.back()->landmarks) {
      if (landmark.IsValid() && ids.insert(landmark).second) landmarks.push_back(&map.point(landmark));
    }
  }
}

void Neighbourhood::Remove(const std::unordered_set<MapPointId>& seen_by_other_side) {
  const auto is_shared = [&](const MapPoint* point) { return seen_by_other_side.count(point->id) == 1; };
  landmarks.erase(std::remove_if(landmarks.begin(), landmarks.end(), is_shared), landmarks.end());
  for (const MapPointId id : seen_by_other_side) ids.erase(id);
}

}  // namespace portolan
