#pragma once

#include "dataset/trajectory_io.h"
#include "geometry/sim3.h"

namespace portolan {

/// The trajectory seen from another frame and at another scale, as of one map; for tests.
inline Trajectory Transformed(Trajectory trajectory, const Sim3d& b_from_a, int map = 0) {
  for (TrajectoryPose& pose : trajectory) {
    pose.world_from_camera =
        Rigid3d(b_from_a.rotation * pose.world_from_camera.rotation, b_from_a * pose.world_from_camera.translation);
    pose.map = map;
  }
  return trajectory;
}

}  // namespace portolan
