#pragma once

#include <deque>
#include <map>

#include "map/protocol.h"

namespace portolan {

/// How far the processes are that look at each keyframe (loop_closer, atlas_server): a lockstep run waits for them.
/// Time is in seconds of any steady clock.
class FollowerWatch {
 public:
  /// Followers repeat their state once a second: one that is silent for so long is gone, and not only short of a
  /// processor on a busy machine. A lockstep run has time.
  static constexpr double kPatienceS = 10.0;
  static constexpr double kStalledS = 15.0;  ///< one that does nothing and gets no further has missed the keyframe

  void OnState(const FollowerState& state, double now_s);
  /// Whether nobody has to be waited for: each has looked at the last keyframe and is not busy. One that has not looked
  /// at any yet came in between, and is told of the next.
  bool AreDone(KeyFrameId last_keyframe, double now_s) const;

 private:
  struct Follower {
    std::deque<KeyFrameId> looked_at;  // the last ones: several robots' keyframes take turns
    bool is_busy = false;
    double heard_s = 0, changed_s = 0;
  };
  std::map<ProcessId, Follower> followers_;
};

}  // namespace portolan
