#pragma once

#include <cstddef>
#include <string>

#include "geometry/sim3.h"
#include "map/map.h"
#include "testing/synthetic_scene.h"

namespace portolan {

/// How far a map is from the truth after the best similarity between them (a monocular map has a frame and a scale of
/// its own). Truth's units.
struct MapError {
  bool aligned = false;  ///< false: fewer than 3 common cameras and points, or all on a line
  Sim3d truth_from_map;
  size_t num_keyframes = 0, num_points = 0;  ///< compared
  double max_rotation_rad = 0;               ///< of a camera
  double max_translation = 0;                ///< of a camera's centre
  double max_point = 0;                      ///< of a point
  double median_point = 0;
  /// Root mean square of the cameras' centres after the similarity that fits them alone: what ATE is, and what a few
  /// points of bad depth don't spoil. Infinity where the centres lie on a line.
  double camera_rmse = 0;
};

/// Compares a map of a scene's keyframes with the scene. A point is the landmark that most of its observations show;
/// one whose observations show none counts as infinitely far. A keyframe that is no view of the scene fails a check.
MapError CompareWithScene(const Map& map, const SyntheticScene& truth);

/// Compares keyframes and points of the same ids. Those that only one of the maps has are left out.
MapError CompareMaps(const Map& map, const Map& truth);

}  // namespace portolan
