#pragma once

#include <cstddef>
#include <unordered_set>
#include <vector>

#include "map/map.h"

namespace portolan {

struct NeighbourhoodOptions {
  size_t neighbours = 10;        ///< covisible keyframes of the keyframe, best first
  size_t second_neighbours = 2;  ///< and of each of those: what lies just outside of their view
  size_t most = 25;              ///< keyframes in all: bounds the time
};

/// A keyframe with the keyframes around it and all their landmarks: one side of a place. Points into the map: valid as
/// long as that does not change.
struct Neighbourhood {
  Neighbourhood(const Map& map, KeyFrameId keyframe, const NeighbourhoodOptions& options);

  const KeyFrame& keyframe() const { return *keyframes.front(); }
  bool Sees(MapPointId id) const { return ids.count(id) == 1; }
  /// Leaves out the landmarks that the other side sees too: they say nothing about whether the two are one place.
  void Remove(const std::unordered_set<MapPointId>& seen_by_other_side);

  std::vector<const KeyFrame*> keyframes;   ///< the keyframe, its covisible ones, theirs
  std::vector<const MapPoint*> landmarks;   ///< each once, in the order in which the keyframes see them
  std::unordered_set<MapPointId> ids;       ///< of the landmarks
};

}  // namespace portolan
