#pragma once

#include <utility>
#include <vector>

#include "geometry/sim3.h"
#include "map/map.h"
#include "testing/map_builder.h"
#include "testing/synthetic_scene.h"

namespace portolan {

/// How a map goes wrong step by step, as a monocular one does until a loop is closed.
struct DriftOptions {
  double scale_step = 1.0;                              ///< lengths grow by this factor from each keyframe to the next
  Eigen::Vector3d turn_step = Eigen::Vector3d::Zero();  ///< rotation vector on top of each step, rad
  double pose_sigma = 0;   ///< noise of each pose: of the translation, map units, and the rotation, rad
  double point_sigma = 0;  ///< noise of points, map units
  /// A landmark unseen for more than so many views and seen again is a new point: the loop is open.
  int revisit_gap = 20;
  uint64_t seed = 1;
};

/// A map with drift, and what it is of.
struct DriftedMap {
  Map map;
  std::vector<double> scales;  ///< of each view: map units for one world unit around it

  /// a_from_b of the cameras of two views as the world has it, in each one's own units: what verification of a loop
  /// should find.
  Sim3d TrueSimilarity(const SyntheticScene& scene, size_t view_a, size_t view_b) const;
  /// (feature of a, point that b sees) of landmarks that both views see.
  std::vector<std::pair<uint32_t, MapPointId>> TrueSightings(const SyntheticScene& scene, size_t view_a,
                                                             size_t view_b) const;
};

/// A map of all of the scene's views, a chain of keyframes in order. Points lie where the middle one of the views that
/// see them puts them; each visit of a landmark is a point of its own. Outliers of the scene are left out.
DriftedMap BuildDriftedMap(const SyntheticScene& scene, const DriftOptions& options);

}  // namespace portolan
