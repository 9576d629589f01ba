#pragma once

#include <Eigen/Core>
#include <optional>
#include <utility>
#include <vector>

#include "base/ids.h"
#include "geometry/rigid3.h"
#include "geometry/sim3.h"
#include "map/map.h"

namespace portolan {

/// How a change of the map (BA, loop closure) moves what a keyframe sees, for what was estimated in the map as it was
/// before: the tracker's pose and velocity stay where they are in the scene.
///
///   MapMotion motion(map, keyframe);
///   ... the map changes ...
///   if (const auto new_from_old = motion.Measure(map)) pose = TransformPose(pose, *new_from_old);
class MapMotion {
 public:
  /// Measures nothing.
  MapMotion() = default;
  /// Notes the keyframe's pose and its landmarks. One that is not in the map measures nothing later.
  MapMotion(const Map& map, KeyFrameId keyframe);

  /// map_from_map, from the map as it was to the map as it is, around the keyframe: its motion, and as scale the median
  /// change of its landmarks' distances. None if the keyframe is gone.
  std::optional<Sim3d> Measure(const Map& map) const;
  KeyFrameId keyframe() const { return keyframe_; }

 private:
  KeyFrameId keyframe_;
  Rigid3d camera_from_map_;
  std::vector<std::pair<MapPointId, double>> distances_;  // of landmarks from the camera, map units
};

}  // namespace portolan
