#pragma once

#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "base/ids.h"
#include "geometry/sim3.h"

namespace portolan {

/// What is known of how maps belong together (paper Sec. 6, step 1): how often the camera went from one to the other,
/// and where they lie to each other. Pure values; one thread uses it.
///
///   MapGraph graph;
///   graph.AddNewMap(map, adjacent);              // mutual activity 1
///   graph.SetLink({map, other, map_from_other}); graph.CountSwitch(map, other);
///   for (const MapId other : graph.ByActivity(map)) ...     // where an overlap is looked for, in this order
///   graph.Merge(map, other, map_from_other);     // a fusion: other is no more
class MapGraph {
 public:
  enum class Origin : uint8_t {
    kNewMap = 0,   ///< frames tracked in the old map and the new one (paper Sec. 3.4)
    kOverlap = 1,  ///< keyframes of one that see the other's place
    kEntered = 2,  ///< the tracker went over from one to the other by itself
  };
  /// Where two maps lie to each other.
  struct Link {
    MapId map, other;
    Sim3d map_from_other;
    Origin origin = Origin::kOverlap;
  };
  /// How often the camera went over between two maps, map < other; 1 for a map that was begun beside the other.
  struct Activity {
    MapId map, other;
    uint64_t count = 0;
  };
  /// `other` went into `map`, and is no more.
  struct Fused {
    MapId map, other;
    Sim3d map_from_other;
  };
  /// All of it, by ids: what is stored.
  struct State {
    std::vector<MapId> maps;
    std::vector<Link> links;
    std::vector<Activity> activities;
    std::vector<Fused> fused;
  };

  MapGraph() = default;
  /// Entries that contradict each other or have no valid similarity are left out.
  explicit MapGraph(const State& state);
  State state() const;
  /// Rises with every change.
  uint64_t version() const { return version_; }

  const std::set<MapId>& maps() const { return maps_; }
  size_t num_links() const { return links_.size(); }
  void AddMap(MapId map);
  /// A map begun where another ended, which may be none.
  void AddNewMap(MapId map, MapId adjacent);
  /// Replaces what was known of the two. Both are added if they are new. No effect between a map and itself, or where
  /// the similarity is none.
  void SetLink(const Link& link);
  /// The camera went from one to the other.
  void CountSwitch(MapId map, MapId other);
  /// `other` went into `map`: its links and activities become map's. Links that map had already stay as they are.
  void Merge(MapId map, MapId other, const Sim3d& map_from_other);
  /// Forgets a map.
  void Remove(MapId map);

  uint64_t ActivityOf(MapId map, MapId other) const;
  /// Between the two themselves, given as asked for.
  std::optional<Link> FindLink(MapId map, MapId other) const;
  /// Along the fewest links (of equal ways the one over the smallest ids); identity for a map itself.
  std::optional<Sim3d> FindWay(MapId map, MapId other) const;
  /// All others, most mutual activity first; of equal ones the youngest first.
  std::vector<MapId> ByActivity(MapId map) const;
  /// Where a map that was fused is now (after further fusions too); the map itself, with identity, otherwise.
  std::pair<MapId, Sim3d> Resolve(MapId map) const;
  const std::map<MapId, Fused>& fused() const { return fused_; }

 private:
  using Pair = std::pair<MapId, MapId>;  // smaller id first
  static Pair PairOf(MapId a, MapId b) { return a < b ? Pair{a, b} : Pair{b, a}; }

  std::set<MapId> maps_;
  std::map<Pair, Link> links_;  // link.map the smaller one
  std::map<Pair, uint64_t> activities_;
  std::map<MapId, Fused> fused_;  // by `other`
  uint64_t version_ = 0;
};

/// Whether numbers are finite, the scale is positive and the rotation a rotation.
bool IsValidSimilarity(const Sim3d& similarity);

/// What a picture or a list shows of a map beside the graph.
struct MapLabel {
  size_t keyframes = 0, points = 0;
  RobotId robot = 0;
  ProcessId owner;
  bool is_active = false;
};

/// {"maps": [{map, keyframes, points, robot, owner, active}], "links": [{map, other, origin, scale, rotation (x, y, z,
/// w), translation}], "activities": [{map, other, count}], "fused": [{map, other, scale, rotation, translation}]};
/// similarities are map_from_other.
std::string ToJson(const MapGraph& graph, const std::map<MapId, MapLabel>& labels);

/// The same for Graphviz: maps as boxes, links as lines (dashed where only activity is known) with the mutual activity.
std::string ToDot(const MapGraph& graph, const std::map<MapId, MapLabel>& labels);

}  // namespace portolan
