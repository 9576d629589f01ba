#include "tracking/follower_watch.h"

namespace portolan {

void FollowerWatch::OnState(const FollowerState& state, double now_s) {
  const auto [entry, is_new] = followers_.try_emplace(state.process);
  Follower& follower = entry->second;
  KeyFrameId& last = follower.last_keyframes[state.map];
  if (is_new || last != state.last_keyframe || follower.is_busy != state.is_busy) follower.changed_s = now_s;
  last = state.last_keyframe;
  follower.is_busy = state.is_busy;
  follower.heard_s = now_s;
}

bool FollowerWatch::AreDone(MapId map, KeyFrameId last_keyframe, double now_s) const {
  for (const auto& [process, follower] : followers_) {
    if (now_s - follower.heard_s > kPatienceS) continue;  // gone
    if (follower.is_busy) return false;
    if (now_s - follower.changed_s > kStalledS) continue;
    const auto last = follower.last_keyframes.find(map);
    if (last == follower.last_keyframes.end()) {
      // It came in between, and is told of the next keyframe; or it has been told of other maps, and this one is yet to come.
      const bool knows_any = follower.last_keyframes.size() > 1 || follower.last_keyframes.begin()->second.IsValid();
      if (knows_any && last_keyframe.IsValid()) return false;
    } else if (last->second.IsValid() && last->second != last_keyframe) {
      return false;
    }
  }
  return true;
}

}  // namespace portolan
