#pragma once

#include <atomic>
#include <unordered_set>

#include "base/ids.h"
#include "base/result.h"
#include "map/map.h"
#include "map/protocol.h"

namespace portolan {

struct FollowerOptions {
  int rounds = 3;          ///< of keyframes, then landmarks; most is gained in the first
  int min_landmarks = 15;  ///< inliers of a keyframe that is moved: fewer don't hold it
};

/// Finds the best places for what a correction only carries along: alternately each keyframe of the correction that is
/// not `held` against the landmarks (motion-only BA), and each landmark of the map against the keyframes. What merely
/// follows is off by the difference between its own correction and that of what it follows; without this, tenths of a
/// pixel that local BA had won would be lost. Replaces the correction's points by all that moved.
/// @return "interrupted" when `stop` (may be null) is raised; the correction is then as it was.
Status RefineFollowers(const Map& map, const std::unordered_set<KeyFrameId>& held, const FollowerOptions& options,
                       const std::atomic<bool>* stop, MapCorrection* correction);

}  // namespace portolan
