#pragma once

#include <string>
#include <vector>

#include "atlas/map_graph.h"
#include "atlas/sqlite.h"

namespace portolan {

// The map graph's tables in the atlas's file (see MapStore):
//   graph_map(id), link(map, other, transform), fused(map, other, transform), activity(map, other, count)
// transform: how the link was found, scale, rotation (x, y, z, w) and translation of map_from_other as doubles, and a
// hash over them and the two maps.

Status MakeGraphTables(SqlDatabase* database);
/// Replaces the map graph as a whole, in the caller's transaction.
Status WriteGraph(const MapGraph::State& graph, SqlDatabase* database);
/// Drops a map's part of the map graph, but not that it went into another.
Status RemoveFromGraph(MapId id, SqlDatabase* database);
/// @param problems gets what is damaged and left out. Fails when the tables can't be read.
Result<MapGraph::State> ReadGraph(SqlDatabase* database, std::vector<std::string>* problems);

}  // namespace portolan
