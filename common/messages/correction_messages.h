#pragma once

#include "base/result.h"
#include "map/protocol.h"
#include "messages/wire.h"

namespace portolan {

wire::MapCorrection ToWire(const MapCorrection& correction);
Result<MapCorrection> FromWire(const wire::MapCorrection& wire);

}  // namespace portolan
