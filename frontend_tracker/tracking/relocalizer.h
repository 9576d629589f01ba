#pragma once

#include <optional>

#include "map/map.h"
#include "tracking/camera_reach.h"
#include "tracking/coarse_to_fine.h"
#include "tracking/frame.h"
#include "tracking/tracker_options.h"
#include "vocabulary/keyframe_index.h"

namespace portolan {

/// Global relocalisation (paper Sec. 3.1, lower branch of Fig. 2): candidate keyframes by shared visual words, matches
/// by vocabulary node, EPnP in RANSAC, then the same coarse-to-fine tracking with the candidate as reference.
class Relocalizer {
 public:
  Relocalizer(const RelocalizerOptions& options, uint64_t seed) : options_(options), seed_(seed) {}

  /// @param reach where the camera can be, if that is known. @param frame with words computed. On success it is tracked
  /// (pose, landmarks, counts), and sure.
  bool Relocalize(const Map& map, const KeyFrameIndex& index, const std::optional<CameraReach>& reach,
                  MapTracker* tracker, Frame* frame) const;

  /// The same against one keyframe, from matches by node alone: when the motion model failed but the place is known.
  /// @param min_inliers to accept. Whether the place is right, something else must vouch for, or IsSure.
  bool TrackKeyFrame(const Map& map, KeyFrameId keyframe, int min_inliers, MapTracker* tracker, Frame* frame) const;

  /// Whether a frame's matches alone tell where it is: more agree with the pose than would by chance with a wrong one,
  /// and in more than a corner of the picture.
  static bool IsSure(const Frame& frame);

 private:
  RelocalizerOptions options_;
  uint64_t seed_;
};

}  // namespace portolan
