#pragma once

#include <string>
#include <utility>
#include <vector>

#include "base/ids.h"
#include "base/result.h"
#include "geometry/sim3.h"
#include "map/map.h"
#include "map/protocol.h"

namespace portolan {

// What applying a correction to one map and taking a map into another have in common.

/// "correction 3 (loop) of 0.1.2", for messages.
std::string NameOf(const MapCorrection& correction);

/// Whether it is finite and its scale positive.
bool IsSimilarity(const Sim3d& similarity);

/// Whether a correction was made for this map, in its epoch, from a revision that was, and its values are finite.
Status CheckCorrection(const MapCorrection& correction, const Map& map);

/// Where a map's keyframes and points come to lie by a correction.
struct MovedMap {
  std::vector<std::pair<KeyFrameId, Rigid3d>> poses;           ///< camera_from_map of all keyframes, by id
  std::vector<std::pair<MapPointId, Eigen::Vector3f>> points;  ///< all whose new position is finite, by id
};

/// Keyframes named by the correction take their similarity, made rigid (paper Eq. 13); others the one of the nearest
/// ancestor in it and their relative pose (paper Sec. 6, step 3), or, where no ancestor is, follow `new_from_old`.
/// Points named take their position, others follow the nearest keyframe that sees them with its similarity (paper Eq.
/// 14).
MovedMap MoveMap(const MapCorrection& correction, const Map& map, const Sim3d& new_from_old);

/// Whether replicas will accept a map so moved (IsSoundPose). A correction of finite values may still throw keyframes
/// out to where they don't: an owner that applied it would be followed by nobody.
Status CheckMoved(const MapCorrection& correction, const MovedMap& moved);

/// The correction's merges that fit, then its observations. @return the merges made (from, into).
std::vector<std::pair<MapPointId, MapPointId>> JoinLandmarks(const MapCorrection& correction, Map* map);

}  // namespace portolan
