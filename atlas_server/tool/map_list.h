#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "atlas/map_graph.h"
#include "base/ids.h"
#include "base/result.h"
#include "map/map_delta.h"

namespace portolan {

/// What the atlas_server answers to list_maps.
struct MapList {
  struct Entry {
    MapId map;
    RobotId robot = 0;  ///< whose tracker began it
    Epoch epoch = 0;    ///< granted to the owner
    ProcessId owner;
    bool owner_alive = false;
    bool is_active = false;  ///< a tracker is in it
    /// Of the state, which the owner may not have taken up in its own yet; a dormant map's stays.
    Epoch state_epoch = 0;
    Revision revision = 0;  ///< of the state
    size_t keyframes = 0, points = 0;
  };
  std::vector<Entry> maps;
  MapId last;  ///< that changed; may be none

  std::vector<MapId> Ids() const;
  const Entry* Find(MapId map) const;
};
/// Fails on a text that is none; entries may lack what the atlas does not know yet.
Result<MapList> ParseMapList(const std::string& json);
/// As a table for people.
std::string FormatMapList(const MapList& list);

/// What the atlas_server answers to map_graph.
struct DescribedGraph {
  MapGraph graph;
  std::map<MapId, MapLabel> labels;
};
Result<DescribedGraph> ParseMapGraph(const std::string& json);
/// Maps, links and fusions in lines for people.
std::string FormatMapGraph(const DescribedGraph& described);

}  // namespace portolan
