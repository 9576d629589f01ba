#pragma once

#include "base/result.h"
#include "map/protocol.h"
#include "messages/wire.h"

namespace portolan {

wire::TrackerState ToWire(const TrackerState& state);
Result<TrackerState> FromWire(const wire::TrackerState& wire);

wire::MapperState ToWire(const MapperState& state);
Result<MapperState> FromWire(const wire::MapperState& wire);

wire::FollowerState ToWire(const FollowerState& state);
Result<FollowerState> FromWire(const wire::FollowerState& wire);

/// Figures that are not finite (a mean of nothing) are left out: they say nothing, and receivers refuse them.
wire::ProcessStatus ToWire(const ProcessStatus& status);
Result<ProcessStatus> FromWire(const wire::ProcessStatus& wire);

}  // namespace portolan
