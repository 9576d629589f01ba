#pragma once

#include <Eigen/Core>
#include <optional>

#include "base/time.h"
#include "geometry/rigid3.h"
#include "map/map.h"
#include "tracking/frame_history.h"

namespace portolan {

/// Beyond the paper: where a camera can be that was tracked a moment ago. Places that look alike are told apart by it
/// when tracking fails in the middle of them: a camera whose pictures follow one another has not jumped.
struct CameraReach {
  Eigen::Vector3d centre_in_map;
  double radius = 0;  ///< map units

  bool Contains(const Rigid3d& camera_from_map) const {
    return (camera_from_map.TargetOriginInSource() - centre_in_map).norm() <= radius;
  }
};

/// From where the camera was last tracked in the map, how fast it was, and how far away what it saw. None if that was
/// too long ago to tell, or never.
std::optional<CameraReach> ReachOfCamera(const FrameHistory& history, const Map& map, Timestamp now);

}  // namespace portolan
