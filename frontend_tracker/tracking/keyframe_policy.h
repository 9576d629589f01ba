#pragma once

#include "map/map.h"
#include "tracking/frame.h"
#include "tracking/tracker_options.h"

namespace portolan {

/// Decides which frames become keyframes (paper Sec. 3.3): as many as the mapper can take, of those which are tracked
/// well and far enough from the others.
class KeyFramePolicy {
 public:
  explicit KeyFramePolicy(const KeyFramePolicyOptions& options) : options_(options) {}

  /// Remembers s_01 / d_0 of a new map's first two keyframes, the right side of Eq. (7).
  void StartMap(const Map& map);
  void NoteKeyFrame(KeyFrameId id, Timestamp stamp) {
    last_keyframe_ = id;
    last_keyframe_stamp_ = stamp;
  }

  enum class Decision {
    kNo,  ///< quality is poor, or too near to another keyframe
    kInsert,
    kInterrupt,  ///< urgent, and only the busy mapper is in the way: tell it to stop optimising (paper Sec. 3.3)
  };
  /// @param frame tracked (IsFound). Beyond the paper that and options.MinPoints are enough where it is urgent and
  /// the mapper idle, as in a fast turn whose pictures are blurred: without new keyframes the camera would be lost.
  Decision Decide(const Map& map, const Frame& frame, bool mapper_idle) const;

  /// First condition: at least options.MinPoints (in the paper 10) and s = n / m > 0.7, or options.sure_points.
  bool IsQualityGood(const Map& map, const Frame& frame) const;
  /// Second condition, Eq. (7): s_ci / d_c > s_01 / d_0.
  bool IsFarEnough(const Map& map, const Frame& frame) const { return IsFar(map, frame, options_.distance_factor); }
  /// The same for a frame from before a map was made, between the two that it was made of.
  bool FillsGap(const Map& map, const Frame& frame) const {
    return IsQualityGood(map, frame) && IsFar(map, frame, options_.gap_distance_factor);
  }
  /// Beyond the paper: the frame has lost sight of much of what its reference keyframe sees, as when the camera turns;
  /// in a known place, of most. Landmarks count that three keyframes see; where few are left to the frame, and it is
  /// sure of them, all.
  bool IsViewNew(const Map& map, const Frame& frame) const;
  /// Whether the frame's reference keyframe is not one of the youngest: the camera is where it, or another, has been
  /// before.
  bool IsInKnownPlace(const Frame& frame) const;
  /// Whether the map ends here, for one that is to get no more keyframes: the frame is too far from all of them (Eq. 7
  /// as it stands in the paper) and not between two, or sees little of the map.
  bool IsLeaving(const Map& map, const Frame& frame) const;
  /// Whether the frame is worth interrupting a busy mapper for: by the same two measures, with their urgent limits, or
  /// before the landmarks run out.
  bool IsUrgent(const Map& map, const Frame& frame) const;

 private:
  /// s_ci / d_c > factor * s_01 / d_0.
  bool IsFar(const Map& map, const Frame& frame, double factor) const;
  /// Fewer than `share` of the reference's landmarks that so many keyframes see are tracked.
  bool HasLost(const Map& map, const Frame& frame, double share, size_t observations) const;

  KeyFramePolicyOptions options_;
  double first_distance_over_depth_ = 0;  // s_01 / d_0
  KeyFrameId last_keyframe_;
  Timestamp last_keyframe_stamp_{INT64_MIN / 2};
};

}  // namespace portolan
