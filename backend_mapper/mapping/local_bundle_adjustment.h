#pragma once

#include <atomic>
#include <vector>

#include "base/ids.h"
#include "map/map.h"
#include "map_optimization/window_problem.h"
#include "mapping/mapper_options.h"
#include "optimization/bundle_adjustment.h"

namespace portolan {

/// The keyframe and those connected to it in the pose graph, the points that they see, and other keyframes that see
/// those points, fixed (paper Sec. 4.2): at least two, unless the map has no more keyframes. Where fewer than two
/// others see them, the oldest of the window are fixed instead: one for the frame, one for the scale. The map's first
/// keyframe never moves.
BundleWindow SelectLocalWindow(const Map& map, KeyFrameId keyframe, const LocalBundleOptions& options);

/// What local BA did.
struct LocalBundleResult {
  BundleSummary summary;          ///< of the last stage that ran; iterations of both
  int keyframes = 0, points = 0;  ///< of the window
  int measurements = 0;
  int outliers = 0;  ///< observations removed
};

/// Optimises a window around a keyframe and puts the result into the map: poses and positions that changed noticeably,
/// observations with gross errors removed, points left with fewer than two removed. Interrupted by `stop` (may be null)
/// it keeps what it reached, but removes nothing unless two iterations were done: errors against an unfinished solution
/// prove nothing.
LocalBundleResult OptimizeLocalWindow(Map* map, KeyFrameId keyframe, const LocalBundleOptions& options,
                                      const std::atomic<bool>* stop);

}  // namespace portolan
