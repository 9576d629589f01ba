#pragma once

#include <Eigen/Core>
#include <vector>

#include "geometry/rigid3.h"

namespace portolan {

/// Where a camera is and looks to, in a world with z up. Angles in radians.
struct CameraStance {
  Eigen::Vector3d position_in_world = Eigen::Vector3d::Zero();
  double yaw = 0;    ///< of the viewing direction: 0 along +x, counter-clockwise seen from above
  double pitch = 0;  ///< upwards
  double roll = 0;   ///< clockwise about the viewing direction
};

/// world_from_camera of a stance; the camera looks along its +z, x right, y down.
Rigid3d WorldFromCamera(const CameraStance& stance);

/// A smooth camera motion: the uniform cubic B-spline (C2) over stances. The spline is the truth; it passes near its
/// stances, not through them.
class CameraPath {
 public:
  /// @param stances at least 2, `interval_s` > 0 apart; yaw is unwrapped here.
  CameraPath(std::vector<CameraStance> stances, double interval_s);

  /// @param t_s seconds from the start, clamped to [0, duration_s()].
  Rigid3d At(double t_s) const;
  double duration_s() const { return interval_s_ * static_cast<double>(stances_.size() - 1); }

 private:
  CameraStance Stance(int64_t i) const;
  std::vector<CameraStance> stances_;
  double interval_s_;
};

/// A drive along a polyline on the ground whose corners are rounded, slower in the corners, with the small sway of a
/// vehicle or walker.
struct RoadOptions {
  double camera_height = 1.6;  ///< m
  double speed = 4.5;          ///< m/s on the straights
  double corner_speed = 3.0;   ///< m/s: with the radius below a right angle takes about 2.6 s
  double corner_radius = 5.0;  ///< m, of the camera's way round a corner
  double sway = 0.02;          ///< m, amplitude up and down; sideways half of it
  double sway_hz = 1.6;        ///< a walker's steps
  double glance = 0.06;        ///< rad, amplitude of slow looking left and right
  double pitch = 0.05;         ///< rad, mean, upwards
};
/// @param corners_in_world at least 2 points, neighbours more than 2 corner radii apart.
CameraPath MakeRoadPath(const std::vector<Eigen::Vector2d>& corners_in_world, const RoadOptions& options);

}  // namespace portolan
