#pragma once

#include <vector>

#include "base/ids.h"
#include "map/map.h"

namespace portolan {

/// The newest keyframes by time of their image, at most `count`, newest first; of equals the lower id first.
std::vector<KeyFrameId> NewestKeyFrames(const Map& map, size_t count);

}  // namespace portolan
