#pragma once

#include "base/result.h"
#include "map/map_delta.h"
#include "map/map_replica.h"
#include "messages/wire.h"

namespace portolan {

/// A chunk of at most kMaxChunkElements elements to the wire. The order of every list is kept.
wire::MapDelta ToWire(const MapDeltaChunk& chunk);
/// Checks the chunk in itself; whether it fits a map is Map::Apply's to say.
Result<MapDeltaChunk> FromWire(const wire::MapDelta& wire);

wire::SnapshotRequest ToWire(const SnapshotRequest& request);
Result<SnapshotRequest> FromWire(const wire::SnapshotRequest& wire);

}  // namespace portolan
