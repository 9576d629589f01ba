#pragma once

#include <atomic>
#include <optional>
#include <unordered_map>
#include <unordered_set>
#include <vector>

#include "base/ids.h"
#include "base/result.h"
#include "geometry/sim3.h"
#include "map/map.h"
#include "map/protocol.h"
#include "map_optimization/follower_refinement.h"
#include "optimization/bundle_adjustment.h"

namespace portolan {

// What global BA and FBA share: BA over some keyframes of a map and a choice of their landmarks, and how that becomes a
// correction of the whole map.

struct KeyFrameAdjustmentOptions {
  /// Landmarks chosen for a keyframe, at least, where it has as many; others follow. By default all are: with 70 of
  /// them the poses came to fit those better and the rest of the map worse (town_lap: mean loss 0.052, against 0.042
  /// before).
  int landmarks_per_keyframe = 100000;
  int max_iterations = 6;            ///< town_lap after its loop: 1.84 m become 1.70 in three, 1.56 in eight
  double function_tolerance = 1e-4;  ///< relative decrease of the cost at which it is done
  FollowerOptions followers;
};

/// Landmarks that at least two of the keyframes see, longest tracks first, until each of these keyframes has its share
/// or no more: one is taken while two of its observers still lack some.
std::vector<MapPointId> SelectLandmarks(const Map& map, const std::vector<KeyFrameId>& keyframes, int per_keyframe);

struct AdjustedKeyFrames {
  /// With the scales at which the map around them has changed (see DepthRatio): others follow by them.
  std::unordered_map<KeyFrameId, Sim3d> camera_from_map;
  std::vector<MapCorrection::PointCorrection> points;
  BundleSummary summary;
  int measurements = 0;
};

/// BA over the keyframes, the first of which is fixed, and their chosen landmarks. The overall scale is left to drift:
/// one pose fixed holds the frame, and a second one fixed would hold an error of theirs for good; KeepFrame puts the
/// scale right afterwards. Keyframes with too few landmarks to be held take no part.
/// @return or why not: fewer than three keyframes take part, the BA failed, "interrupted".
Result<AdjustedKeyFrames> AdjustKeyFrames(const Map& map, const std::vector<KeyFrameId>& keyframes,
                                          const KeyFrameAdjustmentOptions& options, const std::atomic<bool>* stop);

/// Puts keyframes and points into the frame and scale that the map has (all of a monocular map's seven freedoms): its
/// first keyframe keeps its pose, and the root mean square distance of the keyframes from it stays. Without it in the
/// list nothing is done.
void KeepFrame(const Map& map, MapCorrection* correction);

/// What CompleteCorrection compares: mean reprojection losses of the map, refined in the same way.
struct LossChange {
  double without = 0;  ///< the correction
  double with = 0;
};

/// Makes a correction of the whole map of one that has all its keyframes and the points of the BA: followers refined
/// (those not `held`), frame and scale kept.
/// @return why it is none: "interrupted", or no improvement: the map must agree better with all observations, not only
/// those that were optimised, than it does when it is refined in the same way without the correction. `losses` (may be
/// null) gets what was compared, if it came to that.
Status CompleteCorrection(const Map& map, const std::unordered_set<KeyFrameId>& held, const FollowerOptions& options,
                          const std::atomic<bool>* stop, MapCorrection* correction,
                          std::optional<LossChange>* losses = nullptr);

}  // namespace portolan
