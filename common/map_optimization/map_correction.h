#pragma once

#include <string>
#include <utility>
#include <vector>

#include "base/ids.h"
#include "base/result.h"
#include "map/map.h"
#include "map/protocol.h"

namespace portolan {

/// A proposal of this kind made from this map, without content.
MapCorrection EmptyCorrection(const Map& map, const std::string& kind);

/// Applies a proposed correction (loop closure, FBA, global BA) to the map it was made for. Keyframes in it take their
/// corrected poses, the similarity made rigid (paper Eq. 13); keyframes younger than its revision follow the nearest
/// ancestor in it, by their relative pose (paper Sec. 6, step 3). Points in it take their positions; each other point
/// follows the nearest keyframe that sees it, as it was before, with that one's similarity (paper Eq. 14). Then the
/// merges, then the new observations. Keyframes, points, merges and observations that no longer fit are passed over:
/// the map went on since.
/// @return the merges made (from, into). Fails, changing nothing, for another map or epoch, a revision to come,
/// non-finite values, a scale that is not positive, where something would come to lie beyond kMaxCoordinate
/// (delta_check.h), or when no corrected keyframe is left in the map.
Result<std::vector<std::pair<MapPointId, MapPointId>>> ApplyMapCorrection(const MapCorrection& correction, Map* map);

}  // namespace portolan
