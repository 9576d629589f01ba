#pragma once

#include <cstddef>
#include <vector>

#include "map/map.h"

namespace portolan {

struct NeighbourhoodOptions {
  size_t neighbours = 10;        ///< covisible keyframes of the keyframe, best first
  size_t second_neighbours = 2;  ///< and of each of those: what lies just outside of their view
  size_t most = 25;              ///< keyframes in all: bounds the time
};

/// A keyframe and the keyframes around it: one side of a place. Points into the map: valid as long as that does not
/// change.
class Neighbourhood {
 public:
  Neighbourhood(const Map& map, KeyFrameId keyframe, const NeighbourhoodOptions& options);

  const KeyFrame& keyframe() const { return *keyframes_.front(); }
  /// The keyframe, its covisible ones, theirs.
  const std::vector<const KeyFrame*>& keyframes() const { return keyframes_; }
  /// Whether one of its keyframes sees a landmark.
  bool Sees(const MapPoint& landmark) const;

  /// What counts between this side and another: landmarks that the other side does not see too, for those say nothing
  /// about whether the two are one place.
  /// @return one per feature of the keyframe (of this side), null where there is none.
  std::vector<const MapPoint*> LandmarksByFeature(const KeyFrame& keyframe, const Neighbourhood& other) const;
  /// @return those of all keyframes, each once, in the order in which the keyframes see them.
  std::vector<const MapPoint*> Landmarks(const Neighbourhood& other) const;

 private:
  const Map& map_;
  std::vector<const KeyFrame*> keyframes_;
  std::vector<KeyFrameId> sorted_ids_;
};

}  // namespace portolan
