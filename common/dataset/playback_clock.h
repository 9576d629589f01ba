#pragma once

#include <chrono>

#include "base/time.h"

namespace portolan {

/// Says when frames of a recording are due when it is played at `factor` times its speed: start + (stamp - first stamp)
/// / factor. Knows no clock itself: it only computes with the time points it is given.
class PlaybackClock {
 public:
  using TimePoint = std::chrono::steady_clock::time_point;

  /// @param factor above 0; 2 is twice as fast as recorded.
  explicit PlaybackClock(double factor);

  /// The frame of this stamp is due at `now`; all others follow from it.
  void Start(Timestamp first_stamp, TimePoint now);
  bool started() const { return started_; }
  Timestamp first_stamp() const { return first_stamp_; }
  /// Only after Start().
  TimePoint DueAt(Timestamp stamp) const;

 private:
  double factor_;
  bool started_ = false;
  Timestamp first_stamp_;
  TimePoint start_;
};

}  // namespace portolan
