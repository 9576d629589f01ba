#pragma once

#include <deque>
#include <optional>
#include <vector>

#include "tracking/coarse_to_fine.h"
#include "tracking/rotation_estimator.h"

namespace portolan {

/// Localises frames that passed between the two of a map's beginning, and can be known only once the map is there: one
/// at a time, so that no frame of the camera waits for it.
class Backfill {
 public:
  Backfill(const TrackerOptions& options, const PinholeCamera& camera);

  /// @param first of the beginning, tracked. @param between in the order of time; what was left of others goes.
  void Start(Frame first, std::vector<Frame> between);
  /// What is left goes.
  void Stop() { between_.clear(); }
  bool IsDone() const { return between_.empty(); }
  /// Takes the next frame. @return it with its pose, if it could be tracked.
  std::optional<Frame> Next(const Map& map);

 private:
  Rigid3d PredictPose(const Frame& frame) const;

  MapTrackingOptions options_;
  int min_inliers_;
  RotationEstimator rotation_estimator_;
  Frame last_;  // tracked
  std::deque<Frame> between_;
};

}  // namespace portolan
