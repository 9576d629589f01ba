#pragma once

#include <optional>
#include <utility>
#include <vector>

#include "base/ids.h"
#include "geometry/rigid3.h"
#include "geometry/sim3.h"
#include "map/map.h"

namespace portolan {

/// What one frame that is localised in two maps says of how these lie to each other.
struct Overlap {
  Rigid3d camera_from_map, camera_from_other;
  /// Depths in the camera of the features that are a landmark in both maps: (in `map`'s units, in `other`'s units).
  std::vector<std::pair<double, double>> depths;
};

/// A frame in a map: its pose and what landmark each feature is there (none: none).
struct FrameInMap {
  const Map& map;
  Rigid3d camera_from_map;
  const std::vector<MapPointId>& landmarks;
};

/// @param in_map, in_other the same frame: features have the same numbers in both. Landmarks that are gone, and those
/// behind the camera, are left out.
Overlap MakeOverlap(const FrameInMap& in_map, const FrameInMap& in_other);

/// map_from_other that keeps the camera where it is: both poses put it at the same place. @param scale units of `map`
/// per unit of `other`.
Sim3d LinkThroughCamera(const Rigid3d& camera_from_map, const Rigid3d& camera_from_other, double scale);

/// Common features from which a frame counts for a link; with fewer, down to kFewOverlapFeatures, where their depths
/// agree on the scale to kMaxScaleError.
constexpr size_t kMinOverlapFeatures = 20;
constexpr size_t kFewOverlapFeatures = 8;
constexpr double kMaxScaleError = 0.08;  ///< standard error of the median, relative

/// Frames from which their way counts for a link's scale, and that way's least length in median depths.
constexpr size_t kMinWayFrames = 6;
constexpr double kMinWayInDepths = 0.15;

/// map_from_other, from frames localised in both maps: each gives a scale, the median ratio of its features' depths,
/// and by its poses the rest. Scale is the median over frames, or, where the camera has gone far enough, the median
/// ratio of the distances between its places: poses are averages over many landmarks, while depths of young ones err to
/// one side; rotation and translation are those of the frame that agrees best with all others. None without a frame
/// that counts. Beyond paper Sec. 3.4, where overlapping maps are related only once an overlap is found.
std::optional<Sim3d> MeasureLink(const std::vector<Overlap>& overlaps);

}  // namespace portolan
