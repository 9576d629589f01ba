#pragma once

#include <optional>
#include <string>
#include <vector>

#include "base/result.h"
#include "base/time.h"
#include "geometry/rigid3.h"

namespace portolan {

/// A pose of the camera at a time: of the camera in the world (or map) frame, the convention of TUM files.
struct TrajectoryPose {
  Timestamp stamp;
  Rigid3d world_from_camera;
  int map = 0;  ///< number of the map whose frame it is in; 0 when the file has none
};
using Trajectory = std::vector<TrajectoryPose>;

/// Reads a trajectory, telling the form by its content: TUM (8 columns, or 9 with the map number), KITTI poses (12
/// columns; times from `times_file`, or frame numbers as seconds when empty), EuRoC state_groundtruth_estimate csv (17
/// columns, of the body: turned into the camera with T_BS of ../cam0/sensor.yaml if that is there). A file without
/// lines is an empty trajectory. Fails naming file, line and what was expected: a number that is none or not finite, no
/// rotation, times that do not rise within a map.
Result<Trajectory> ReadTrajectory(const std::string& path, const std::string& times_file = "");

/// Writes TUM lines "stamp tx ty tz qx qy qz qw", with the map number as ninth column if asked. Written to a temporary
/// name and renamed: never half a file. Fails on a full disk or an unwritable folder.
Status WriteTrajectory(const std::string& path, const Trajectory& trajectory, bool with_map);

}  // namespace portolan
