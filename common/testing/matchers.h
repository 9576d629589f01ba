#pragma once

#include <gmock/gmock.h>

#include <cmath>

#include "geometry/rigid3.h"
#include "geometry/sim3.h"
#include "testing/map_comparison.h"

// What tests expect, for EXPECT_THAT: RigidNear, Sim3Near, MapNear.

namespace portolan {

/// Bounds of RigidNear and MapNear. Rotations in radians; lengths in the units of what is compared (for maps: of the
/// truth).
struct PoseTolerance {
  double rotation_rad = 1e-6;
  double translation = 1e-6;
};
struct MapTolerance {
  double rotation_rad = 1e-3;  ///< of every camera
  double translation = 1e-3;   ///< of every camera's centre
  double point = 1e-2;         ///< of every point
};

MATCHER_P2(RigidNear, expected, tolerance, "is within the tolerance of a rigid motion") {
  const double angle = expected.rotation.angularDistance(arg.rotation);
  const double distance = (expected.translation - arg.translation).norm();
  *result_listener << "off by " << angle << " rad and " << distance;
  return angle <= tolerance.rotation_rad && distance <= tolerance.translation;
}

/// The same for similarities; the scale's ratio may differ from 1 by `scale`.
MATCHER_P3(Sim3Near, expected, tolerance, scale, "is within the tolerance of a similarity") {
  const double angle = expected.rotation.angularDistance(arg.rotation);
  const double distance = (expected.translation - arg.translation).norm();
  const double ratio = arg.scale / expected.scale;
  *result_listener << "off by " << angle << " rad, " << distance << " and a factor of " << ratio;
  return angle <= tolerance.rotation_rad && distance <= tolerance.translation && std::abs(ratio - 1) <= scale;
}

namespace internal {
inline MapError CompareToTruth(const Map& map, const SyntheticScene& truth) {
  return CompareWithScene(map, truth);
}
inline MapError CompareToTruth(const Map& map, const Map& truth) {
  return CompareMaps(map, truth);
}
}  // namespace internal

/// EXPECT_THAT(map, MapNear(scene, tolerance)): a map, after the best similarity, has every camera and point near the
/// truth (a SyntheticScene or another Map). An empty map is near nothing.
MATCHER_P2(MapNear, truth, tolerance, "is, but for a similarity, near the true map") {
  const MapError error = internal::CompareToTruth(arg, truth);
  if (!error.aligned) {
    *result_listener << "can't be aligned: " << error.num_keyframes << " keyframes and " << error.num_points
                     << " points in common";
    return false;
  }
  *result_listener << error.num_keyframes << " keyframes off by at most " << error.max_rotation_rad << " rad and "
                   << error.max_translation << ", " << error.num_points << " points by at most " << error.max_point;
  return error.max_rotation_rad <= tolerance.rotation_rad && error.max_translation <= tolerance.translation &&
         error.max_point <= tolerance.point;
}

}  // namespace portolan
