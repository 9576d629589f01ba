#pragma once

#include <memory>
#include <vector>

#include "base/time.h"
#include "map/keyframe.h"
#include "tracking/rotation_estimator.h"

namespace portolan {

/// An image on its way through the tracker: what was seen, and what the tracker makes of it.
struct Frame {
  uint64_t number = 0;
  Timestamp stamp;
  std::shared_ptr<const KeyFrameData> data;  ///< features and grid; bow and nodes only once ComputeWords was called
  SmallImage small;
  /// Orientation by dead reckoning from the run's first frame: turns of tracked poses, and where there are none those
  /// that ESM sees.
  Eigen::Quaterniond camera_from_start = Eigen::Quaterniond::Identity();

  MapId map;                          ///< in which it is tracked; none: in none
  Rigid3d camera_from_map;            ///< meaningful once tracked
  std::vector<MapPointId> landmarks;  ///< one per feature; none where the feature is no landmark
  int num_inliers = 0;                ///< n: landmarks that agree with the pose
  int num_candidates = 0;             ///< m: landmarks used for the pose
  KeyFrameId reference;               ///< keyframe that shares most landmarks with it

  /// s = n / m (paper Sec. 3.3).
  double Quality() const { return num_candidates > 0 ? static_cast<double>(num_inliers) / num_candidates : 0.0; }
};

}  // namespace portolan
