#pragma once

#include <string>

#include "base/result.h"
#include "map/map.h"

namespace portolan {

/// Points as vertices, coloured by how many keyframes see them (blue: two, yellow: ten or more), and the camera's
/// centres at the keyframes in red. Binary PLY, map units.
Status WriteMapPly(const std::string& path, const Map& map);

/// Poses of the keyframes in the map's frame, in the order of time, as TUM lines.
Status WriteKeyFrameTrajectory(const std::string& path, const Map& map);

}  // namespace portolan
