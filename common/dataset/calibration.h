#pragma once

#include <string>

#include "base/result.h"
#include "geometry/camera_model.h"

namespace portolan {

/// Reads a camera calibration, telling the form by its content: Portolan's own YAML (model: pinhole | fisheye, width,
/// height, fx, fy, cx, cy, distortion, fps), EuRoC sensor.yaml, KITTI calib.txt, ROS camera_info as camera_calibration
/// writes it (camera_matrix, ...) or as `ros2 topic echo --once` prints it (k, d, ...), ORB-SLAM style YAML (Camera.fx,
/// Camera1.fx, ...). Fails, naming the file, the key (and line) and what was expected: a missing, unknown or repeated
/// key, a value that is not finite, a focal length that is not positive. Unknown keys are refused in Portolan's own
/// form only: the others' files hold more than a camera. KITTI's and ORB-SLAM's older form have no image size: width
/// and height come back 0 and the source fills them in from the first image.
/// @param kitti_camera  0 to 3: the row P0 to P3 of a KITTI file.
Result<CameraModel> ReadCalibration(const std::string& path, int kitti_camera = 0);

}  // namespace portolan
