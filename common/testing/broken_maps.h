#pragma once

#include <string>
#include <vector>

#include "map/map.h"
#include "testing/synthetic_scene.h"

namespace portolan {

/// A delta that a replica must refuse, and the rule that it breaks.
struct BrokenDelta {
  std::string name;
  MapDelta delta;
};

/// The right delta that the broken ones are made from: it brings in the scene's view `next_view` and a new point seen
/// by it and by the map's last keyframe, and moves a pose and a point.
/// @param map as the replica holds it: from BuildMap(scene), its delta taken (revision 1 or more), with at least two
/// keyframes and a free feature in the last one (num_clutter above 0); `next_view` is not in it.
MapDelta MakeGoodDelta(const Map& map, const SyntheticScene& scene, size_t next_view);

/// One delta per rule of Map::Apply, each MakeGoodDelta but for one thing.
std::vector<BrokenDelta> MakeBrokenDeltas(const Map& map, const SyntheticScene& scene, size_t next_view);

/// A map that an audit must object to, and a word of the objection.
struct BrokenMap {
  std::string name;
  Map map;
  std::string objection;  ///< part of a line of ValidateMap
};

/// BuildMap of the scene's first three views, with one invariant broken each.
std::vector<BrokenMap> MakeBrokenMaps(const SyntheticScene& scene);

}  // namespace portolan
