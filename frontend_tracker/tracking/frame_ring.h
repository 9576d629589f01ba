#pragma once

#include <deque>
#include <vector>

#include "geometry/sim3.h"
#include "tracking/frame.h"

namespace portolan {

/// The last frames that were tracked in the active map, from which a new map begins so that it overlaps this one (paper
/// Sec. 3.4), and those since that could not be tracked. Bounded.
class FrameRing {
 public:
  explicit FrameRing(size_t capacity) : capacity_(capacity) {}

  /// @param frame tracked in frame.map. One of another map than those before forgets these.
  void Add(const Frame& frame);
  /// @param frame not tracked; its pose is a prediction.
  void AddFailed(const Frame& frame);
  void Clear();
  /// The map moved under the camera (see MapMotion), or became part of another one.
  void MoveWithMap(MapId map, const Sim3d& map_from_old);

  const std::deque<Frame>& frames() const { return frames_; }
  const std::deque<Frame>& failed() const { return failed_; }

  /// The youngest frames among which the camera has moved enough for a map to begin: from the latest frame whose
  /// landmarks, as far as the newest frame sees them too, moved by `min_baseline_px` in the image once the rotation is
  /// compensated (paper Eq. 8, median). All frames if none is so far away, but none from before the newest has fewer
  /// than `min_common` landmarks in common with.
  std::vector<Frame> Overlapping(double min_baseline_px, size_t min_common) const;

 private:
  size_t capacity_;
  std::deque<Frame> frames_;
  std::deque<Frame> failed_;  // since the last of frames_
};

/// Median image motion, pixels, of the landmarks that two tracked frames have in common, with the rotation between the
/// frames compensated (paper Eq. 8).
/// @param num_common set to their number.
double CompensatedMotionPx(const Frame& first, const Frame& second, size_t* num_common);

}  // namespace portolan
