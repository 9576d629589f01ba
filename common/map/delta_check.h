#pragma once

#include "base/result.h"
#include "map/map.h"

namespace portolan {

/// Largest coordinate of a point or a camera that a delta may bring in, map units: far beyond any map (its keyframes
/// start about one unit apart), and small enough that squared distances stay finite floats.
constexpr double kMaxCoordinate = 1e9;

/// Whether a pose is a rigid motion within kMaxCoordinate, a position within it too: what replicas accept.
bool IsSoundPose(const Rigid3d& pose);
bool IsSoundPosition(const Eigen::Vector3f& position);

/// Whether a valid map stays valid under a delta: what Map::Apply demands before it changes anything. The delta's ids
/// must be distinct within their list and known, its values finite; keyframes form one tree; a feature shows one
/// landmark and a landmark is seen by a keyframe once and by two at least; what replaces a removed point or holds what
/// hung on a removed keyframe stays, or is removed further down the list (so these chains end). Time grows with the
/// delta, and with the number of keyframes where it removes some.
/// @return Ok, or the first contradiction in words.
Status CheckDelta(const Map& map, const MapDelta& delta, const Map::FindData& find_data);

}  // namespace portolan
