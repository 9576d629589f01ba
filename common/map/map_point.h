#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "base/ids.h"
#include "features/feature_set.h"

namespace portolan {

/// Feature `feature` of keyframe `keyframe` sees the landmark.
struct Observation {
  KeyFrameId keyframe;
  uint32_t feature = 0;

  friend bool operator==(const Observation& a, const Observation& b) {
    return a.keyframe == b.keyframe && a.feature == b.feature;
  }
};

/// A landmark. Position is a float: what is sent is what is kept, so replicas are equal to the bit.
struct MapPoint {
  MapPointId id;
  Eigen::Vector3f position_in_map = Eigen::Vector3f::Zero();
  std::vector<Observation> observations;  ///< sorted by keyframe, at most one per keyframe

  // Derived from the observations by Map::RefreshDerived; not sent.
  Eigen::Vector3f mean_viewing_direction = Eigen::Vector3f::Zero();  ///< unit, from the cameras to the point
  float min_distance = 0;  ///< to a camera in which its features could still be detected, map units
  float max_distance = 0;
  Descriptor descriptor{};  ///< of the observation with the least median distance to the others
  uint8_t stale = 0;        ///< Map's own: which of these are out of date

  const Observation* FindObservation(KeyFrameId keyframe) const;
  /// At its place. Of a keyframe that has none yet.
  void InsertObservation(const Observation& observation);
};

}  // namespace portolan
