#pragma once

#include <vector>

#include "base/result.h"
#include "map/map_delta.h"

namespace portolan {

/// Whether the change goes on from this state of its map.
inline bool Continues(const MapDelta& change, Epoch epoch, Revision revision) {
  return !change.IsSnapshot() && change.epoch == epoch && change.base_revision == revision;
}

/// The state of a map after changes of it, as Map::Snapshot() would have it: without the map, as that needs the data of
/// its keyframes.
/// @param snapshot as of Map::Snapshot().
/// @return why not, where a change does not continue the one before, or changes what is not there.
Result<MapDelta> MergeChanges(const MapDelta& snapshot, const std::vector<MapDelta>& changes);

}  // namespace portolan
