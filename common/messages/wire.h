#pragma once

#include <portolan_idl/command.h>
#include <portolan_idl/correction.h>
#include <portolan_idl/keyframe.h>
#include <portolan_idl/map_delta.h>
#include <portolan_idl/sensor_msgs.h>
#include <portolan_idl/status.h>

namespace portolan {

/// The generated types in force.
namespace wire = wire_v1;

}  // namespace portolan
