#pragma once

#include <utility>
#include <vector>

#include "base/ids.h"
#include "map/map.h"
#include "mapping/mapper_options.h"

namespace portolan {

/// What fusion changed.
struct FusionResult {
  int observations = 0;                                   ///< added
  std::vector<std::pair<MapPointId, MapPointId>> merges;  ///< (from, into), in order
};

/// Projects landmarks into a keyframe (paper Sec. 4.2: "new measurements corresponding to the new features"). Where one
/// finds a feature with its descriptor, it gains an observation, or, if the feature is a landmark already, the two
/// become one: that with more observations stays.
/// @param points ids; those that don't exist (any more) or are seen by the keyframe are passed over.
/// Derived fields of the points must be up to date. Adds to `result`.
void FuseIntoKeyFrame(Map* map, KeyFrameId target, const std::vector<MapPointId>& points, const FusionOptions& options,
                      FusionResult* result);

/// The landmarks of a keyframe against its neighbours and their neighbours, both ways.
FusionResult FuseWithNeighbours(Map* map, KeyFrameId keyframe, const FusionOptions& options);

}  // namespace portolan
