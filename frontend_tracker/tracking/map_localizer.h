#pragma once

#include <vector>

#include "map/map.h"
#include "tracking/coarse_to_fine.h"
#include "tracking/frame.h"
#include "tracking/relocalizer.h"
#include "tracking/tracker_options.h"
#include "vocabulary/keyframe_index.h"

namespace portolan {

/// Localises frames in maps where the camera has not just been: near a pose that is known from another map, or by
/// words. The keyframes that look at the place take the part of the last frame (paper Sec. 3.2).
class MapLocalizer {
 public:
  explicit MapLocalizer(const TrackerOptions& options)
      : options_(options), tracker_(options.map_tracking), relocalizer_(options.relocalizer, options.seed) {}

  /// @param predicted_camera_from_map roughly right. @param frame not of this map yet; on success it is tracked there.
  /// @return success; on failure the frame's pose and landmarks mean nothing.
  bool LocalizeNear(const Map& map, const Rigid3d& predicted_camera_from_map, Frame* frame);
  /// @param frame with words computed.
  bool LocalizeByWords(const Map& map, const KeyFrameIndex& index, Frame* frame);

 private:
  const TrackerOptions options_;
  MapTracker tracker_;
  Relocalizer relocalizer_;
};

/// Keyframes that see most of the landmarks that a camera at this pose would have in its picture, the best first, at
/// most `most`; looked for among those that stand near and look the same way.
std::vector<KeyFrameId> KeyFramesInView(const Map& map, const PinholeCamera& camera, const Rigid3d& camera_from_map,
                                        size_t most);

/// Landmarks of the keyframes in view, as references for the coarse stage.
std::vector<ReferenceLandmark> LandmarksInView(const Map& map, const PinholeCamera& camera,
                                               const Rigid3d& camera_from_map);

}  // namespace portolan
