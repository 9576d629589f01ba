#pragma once

#include "base/config_reader.h"
#include "tracking/tracker_options.h"

namespace portolan {

/// Reads and checks the sections tracker and orb.
Status ReadTrackerOptions(ConfigReader* config, TrackerOptions* options);

}  // namespace portolan
