#pragma once

#include <cstdint>
#include <utility>
#include <vector>

#include "base/ids.h"
#include "map/map.h"
#include "optimization/pose_graph.h"

namespace portolan {

struct EssentialGraphOptions {
  int min_common = 100;       ///< landmarks that make two keyframes strongly covisible
  int max_per_keyframe = 10;  ///< covisibility edges of a keyframe, strongest first: bounds the time
};

/// The Sim3 pose graph of a map: spanning tree, strong covisibility and loop edges (paper Sec. 5, third step). Relative
/// poses are those of the map; every scale is 1: a keyframe's own units are the map's. The map's first keyframe is
/// fixed.
struct EssentialGraph {
  std::vector<KeyFrameId> keyframes;  ///< of the nodes, ascending
  std::vector<double> depths;         ///< median depths of what they see, map units: lengths of the edges to them
  PoseGraph graph;

  uint32_t IndexOf(KeyFrameId id) const;  ///< a check fails if it is not there
  Sim3d& camera_from_map(KeyFrameId id) { return graph.nodes[IndexOf(id)].camera_from_map; }
  const Sim3d& camera_from_map(KeyFrameId id) const { return graph.nodes[IndexOf(id)].camera_from_map; }
  /// @param common landmarks that hold the two together: an edge counts by them, so that drift goes to where it came
  /// from, to the keyframes that see little in common.
  void AddEdge(KeyFrameId a, KeyFrameId b, const Sim3d& b_from_a, int common);
};

/// @param loop_edges of loops closed earlier, so that they hold; those whose keyframes are gone are passed over.
EssentialGraph MakeEssentialGraph(const Map& map, const std::vector<std::pair<KeyFrameId, KeyFrameId>>& loop_edges,
                                  const EssentialGraphOptions& options);

}  // namespace portolan
