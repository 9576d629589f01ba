#pragma once

#include <Eigen/Core>
#include <vector>

#include "map/map.h"

namespace portolan {

/// The part of the map that a frame may see (paper Sec. 3.2): keyframes that share landmarks with it, their neighbours
/// in the pose graph, and the landmarks of all these, laid out for a fast pass. Rebuilt only when its keyframes or the
/// map have changed.
class LocalMap {
 public:
  struct Landmark {
    MapPointId id;
    Eigen::Vector3d position_in_map;
    Eigen::Vector3f mean_viewing_direction;
    float min_distance = 0, max_distance = 0;
    Descriptor descriptor{};
  };

  /// @param landmarks of the frame, one per feature (none allowed). @param max_keyframes bounds the keyframes taken.
  void Update(const Map& map, const std::vector<MapPointId>& landmarks, int max_keyframes);
  void Clear() { *this = LocalMap(); }

  const std::vector<Landmark>& landmarks() const { return landmarks_; }
  /// Most shared landmarks first.
  const std::vector<KeyFrameId>& keyframes() const { return keyframes_; }
  /// The keyframe which shares most landmarks with the frame; none if none does.
  KeyFrameId reference() const { return reference_; }

 private:
  void SelectKeyFrames(const Map& map, const std::vector<MapPointId>& landmarks, int max_keyframes);
  void CollectLandmarks(const Map& map);

  std::vector<KeyFrameId> keyframes_;
  std::vector<Landmark> landmarks_;
  KeyFrameId reference_;
  std::vector<KeyFrameId> collected_keyframes_;  // sorted: of the landmarks_ at hand
  MapId collected_map_;
  Revision collected_revision_ = 0;
};

}  // namespace portolan
