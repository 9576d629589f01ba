#pragma once

#include <map>
#include <optional>

#include "map/protocol.h"

namespace portolan {

/// How far the processes are that look at each keyframe (loop_closer, atlas_server): a lockstep run waits for them. Time is in seconds of any steady clock.
class FollowerWatch {
 public:
  static constexpr double kPatienceS = 3.0;  ///< followers repeat their state once a second: one that is silent for so long is gone
  static constexpr double kStalledS = 5.0;   ///< one that does nothing and gets no further has missed the keyframe

  void OnState(const FollowerState& state, double now_s);
  bool Knows(ProcessId process) const { return followers_.count(process) == 1; }
  bool empty() const { return followers_.empty(); }
  /// Whether nobody has to be waited for: each has looked at the map's last keyframe and is not busy.
  bool AreDone(MapId map, KeyFrameId last_keyframe, double now_s) const;

 private:
  struct Follower {
    std::map<MapId, KeyFrameId> last_keyframes;
    bool is_busy = false;
    double heard_s = 0, changed_s = 0;
  };
  std::map<ProcessId, Follower> followers_;
};

}  // namespace portolan
