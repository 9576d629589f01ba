#pragma once

#include <unordered_set>

#include "base/ids.h"
#include "map/map.h"

namespace portolan {

/// How many of the old map's units are one of the new map's around a keyframe: the median ratio of depths in its
/// camera, old to new, over its landmarks among `points` (ids of the new map). A pose and positions alone don't tell
/// how much the map has grown there, and what follows the keyframe must grow with it: its similarity is [s R, s t] with
/// this s.
/// @return `otherwise` when fewer than ten of them are in front of it.
double DepthRatio(const Map& old_map, const Map& new_map, KeyFrameId keyframe,
                  const std::unordered_set<MapPointId>& points, double otherwise);

}  // namespace portolan
