#pragma once

#include <utility>
#include <vector>

#include "base/ids.h"
#include "map/map.h"

namespace portolan {

/// How a landmark is found in a keyframe.
struct LandmarkFusionOptions {
  double chi2 = 5.991;    ///< squared normalised distance of the feature to the projection: 95 % of right ones
  int max_distance = 50;  ///< Hamming
  /// Of two landmarks that are one, the one that was projected stays; else that with more observations.
  bool keep_projected = false;
};

/// What fusion changed.
struct FusionResult {
  std::vector<std::pair<MapPointId, Observation>> observations;  ///< added, in order
  std::vector<std::pair<MapPointId, MapPointId>> merges;         ///< (from, into), in order
};

/// Projects landmarks into a keyframe (paper Sec. 4.2: "new measurements corresponding to the new features"). Where one
/// finds a feature with its descriptor, it gains an observation, or, if the feature is a landmark already, the two
/// become one.
/// @param points ids; those that don't exist (any more) or are seen by the keyframe are passed over. Derived fields of
/// the points must be up to date. In a keyframe without descriptors nothing is found. Adds to `result`.
void FuseIntoKeyFrame(Map* map, KeyFrameId target, const std::vector<MapPointId>& points,
                      const LandmarkFusionOptions& options, FusionResult* result);

/// Landmarks of several keyframes, each once, in order of first appearance.
std::vector<MapPointId> LandmarksOf(const Map& map, const std::vector<KeyFrameId>& keyframes);

}  // namespace portolan
