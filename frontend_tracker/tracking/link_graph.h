#pragma once

#include <functional>
#include <limits>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "base/ids.h"
#include "geometry/sim3.h"
#include "tracking/map_motion.h"

namespace portolan {

/// The maps that the tracker has heard of and how they lie to each other (paper Sec. 6: the map graph). A link is
/// measured at one place; when a map is corrected later, the link moves with what a keyframe near that place sees.
class LinkGraph {
 public:
  /// The tracker's replica of a map, null if it has none.
  using FindMap = std::function<const Map*(MapId)>;
  explicit LinkGraph(FindMap find_map) : find_map_(std::move(find_map)) {}

  /// A place in a map; the keyframe may be none: then the link does not follow corrections of that map.
  struct Place {
    MapId map;
    KeyFrameId keyframe;
  };
  /// Sets the link of two maps. @param map_from_other as the maps are now.
  void Link(const Place& map, const Place& other, const Sim3d& map_from_other);
  bool AreLinked(MapId a, MapId b) const { return links_.count(Key(a, b)) == 1; }
  /// The two maps have been one after the other the active one.
  void NoteActivity(MapId a, MapId b) { ++activity_[Key(a, b)]; }
  /// `map` has taken in `other`: links of `other` are `map`'s from now on. Call before the replica of `other` goes.
  void Fuse(MapId map, MapId other, const Sim3d& map_from_other);
  void Forget(MapId map);

  /// target_from_source along the fewest links, as the maps are now; none if there is no way.
  std::optional<Sim3d> Find(MapId target, MapId source) const;
  /// Maps that can be reached: those with most mutual activity with `from` first, then by number of links on the way,
  /// then by id.
  /// @param max_links on the way; each adds its drift.
  std::vector<MapId> Reachable(MapId from, int max_links = std::numeric_limits<int>::max()) const;
  int Activity(MapId a, MapId b) const;
  size_t num_links() const { return links_.size(); }

 private:
  using Pair = std::pair<MapId, MapId>;  // the lower id first
  struct Edge {
    Sim3d first_from_second;
    MapMotion motion_of_first, motion_of_second;
  };
  static Pair Key(MapId a, MapId b) { return a < b ? Pair(a, b) : Pair(b, a); }
  MapMotion MotionAt(const Place& place) const;
  Sim3d MotionOf(MapId map, const MapMotion& motion) const;
  /// Its Sim3 as the maps are now.
  Sim3d FirstFromSecond(const Pair& maps, const Edge& edge) const;
  std::map<MapId, std::pair<MapId, int>> Search(MapId from) const;  // predecessor and number of links, breadth first

  FindMap find_map_;
  std::map<Pair, Edge> links_;
  std::map<Pair, int> activity_;
};

}  // namespace portolan
