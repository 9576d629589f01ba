#include "map_optimization/essential_graph.h"

#include <algorithm>
#include <cmath>
#include <set>

#include "base/check.h"

namespace portolan {
namespace {

constexpr int kFewestCommon = 5;        // an edge of the spanning tree counts for something, whatever was pruned since
constexpr double kUsualCommon = 100.0;  // landmarks of an edge of weight 1

/// Pairs of keyframes that the map itself connects, (older, younger), each once.
std::set<std::pair<KeyFrameId, KeyFrameId>> CollectPairs(const Map& map, const EssentialGraphOptions& options) {
  std::set<std::pair<KeyFrameId, KeyFrameId>> pairs;
  for (const auto& [id, keyframe] : map.keyframes()) {
    if (keyframe.parent.IsValid()) pairs.insert(std::minmax(keyframe.parent, id));
    for (const auto& [other, common] :
         map.CovisibleKeyFrames(id, options.min_common, static_cast<size_t>(options.max_per_keyframe))) {
      pairs.insert(std::minmax(other, id));
    }
  }
  return pairs;
}

/// A keyframe that sees nothing has no depth of its own: that of its parent, or the map's unit.
double DepthOf(const Map& map, KeyFrameId id) {
  for (KeyFrameId ancestor = id; ancestor.IsValid(); ancestor = map.keyframe(ancestor).parent) {
    const double depth = map.MedianDepth(ancestor);
    if (depth > 0) return depth;
  }
  return 1.0;
}

}  // namespace

uint32_t EssentialGraph::IndexOf(KeyFrameId id) const {
  const auto found = std::lower_bound(keyframes.begin(), keyframes.end(), id);
  PORTOLAN_CHECK(found != keyframes.end() && *found == id) << "keyframe " << id << " is not in the graph";
  return static_cast<uint32_t>(found - keyframes.begin());
}

void EssentialGraph::AddEdge(KeyFrameId a, KeyFrameId b, const Sim3d& b_from_a, int common) {
  // The error of a relative pose falls with the square root of the landmarks it was measured by.
  const double weight = std::sqrt(std::max(common, kFewestCommon) / kUsualCommon);
  const uint32_t j = IndexOf(b);
  graph.edges.push_back({IndexOf(a), j, b_from_a, weight, depths[j]});
}

EssentialGraph MakeEssentialGraph(const Map& map, const std::vector<std::pair<KeyFrameId, KeyFrameId>>& loop_edges,
                                  const EssentialGraphOptions& options) {
  EssentialGraph result;
  for (const auto& [id, keyframe] : map.keyframes()) {
    result.keyframes.push_back(id);
    result.depths.push_back(DepthOf(map, id));
    result.graph.nodes.push_back({Sim3d(keyframe.camera_from_map), !keyframe.parent.IsValid()});
  }
  auto pairs = CollectPairs(map, options);
  for (const auto& [a, b] : loop_edges) {
    if (a != b && map.FindKeyFrame(a) != nullptr && map.FindKeyFrame(b) != nullptr) pairs.insert(std::minmax(a, b));
  }
  for (const auto& [a, b] : pairs) {
    result.AddEdge(a, b, Sim3d(map.keyframe(b).camera_from_map * map.keyframe(a).camera_from_map.Inverse()),
                   map.Covisibility(a, b));
  }
  return result;
}

}  // namespace portolan
