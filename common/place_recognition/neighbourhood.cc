#include "place_recognition/neighbourhood.h"

#include <algorithm>
#include <functional>

namespace portolan {
namespace {

std::vector<KeyFrameId> SelectKeyFrames(const Map& map, KeyFrameId keyframe, const NeighbourhoodOptions& options) {
  std::vector<KeyFrameId> selected{keyframe};
  if (options.neighbours == 0) return selected;  // 0 would ask the map for all
  const auto add = [&](KeyFrameId id) {
    const bool is_new = std::find(selected.begin(), selected.end(), id) == selected.end();
    if (is_new && selected.size() < options.most) selected.push_back(id);
  };
  const auto neighbours = map.CovisibleKeyFrames(keyframe, 1, options.neighbours);
  for (const auto& [id, common] : neighbours) add(id);
  if (options.second_neighbours == 0) return selected;
  for (const auto& [id, common] : neighbours) {
    for (const auto& [second, second_common] : map.CovisibleKeyFrames(id, 1, options.second_neighbours)) add(second);
  }
  return selected;
}

/// A set that is filled once, in one piece of memory: ten thousand sightings of some thousand landmarks, for each
/// candidate that is verified.
class SeenLandmarks {
 public:
  explicit SeenLandmarks(size_t most) {
    size_t places = 1;
    while (places < 2 * most + 1) places *= 2;  // half empty at least
    ids_.resize(places);
  }
  /// @return whether it is new.
  bool Insert(MapPointId id) {
    size_t place = std::hash<MapPointId>()(id) & (ids_.size() - 1);
    for (; ids_[place].IsValid(); place = (place + 1) & (ids_.size() - 1)) {
      if (ids_[place] == id) return false;
    }
    ids_[place] = id;
    return true;
  }

 private:
  std::vector<MapPointId> ids_;  // none: free
};

}  // namespace

Neighbourhood::Neighbourhood(const Map& map, KeyFrameId keyframe, const NeighbourhoodOptions& options)
    : map_(map), sorted_ids_(SelectKeyFrames(map, keyframe, options)) {
  for (const KeyFrameId id : sorted_ids_) keyframes_.push_back(&map.keyframe(id));
  std::sort(sorted_ids_.begin(), sorted_ids_.end());
}

bool Neighbourhood::Sees(const MapPoint& landmark) const {
  return std::any_of(landmark.observations.begin(), landmark.observations.end(), [&](const Observation& o) {
    return std::binary_search(sorted_ids_.begin(), sorted_ids_.end(), o.keyframe);
  });
}

std::vector<const MapPoint*> Neighbourhood::LandmarksByFeature(const KeyFrame& keyframe,
                                                               const Neighbourhood& other) const {
  const std::vector<MapPointId> ids = keyframe.landmarks.ByFeature();
  std::vector<const MapPoint*> landmarks(ids.size(), nullptr);
  for (size_t i = 0; i < ids.size(); ++i) {
    if (!ids[i].IsValid()) continue;
    const MapPoint& point = map_.point(ids[i]);
    if (&map_ != &other.map_ || !other.Sees(point)) landmarks[i] = &point;
  }
  return landmarks;
}

std::vector<const MapPoint*> Neighbourhood::Landmarks(const Neighbourhood& other) const {
  size_t sightings = 0;
  for (const KeyFrame* keyframe : keyframes_)
    sightings += static_cast<size_t>(keyframe->landmarks.end() - keyframe->landmarks.begin());
  std::vector<const MapPoint*> landmarks;
  SeenLandmarks seen(sightings);
  for (const KeyFrame* keyframe : keyframes_) {
    for (const MapPointId id : keyframe->landmarks) {
      if (!seen.Insert(id)) continue;
      const MapPoint& point = map_.point(id);
      if (&map_ != &other.map_ || !other.Sees(point)) landmarks.push_back(&point);
    }
  }
  return landmarks;
}

}  // namespace portolan
