#include "tracking/follower_watch.h"

#include <algorithm>

namespace portolan {
namespace {

// Keyframes of all robots that a follower looks at: a mapper that takes another's map over names its own last one until
// it gets a next.
constexpr size_t kRemembered = 256;

}  // namespace

void FollowerWatch::OnState(const FollowerState& state, double now_s) {
  const auto [entry, is_new] = followers_.try_emplace(state.process);
  Follower& follower = entry->second;
  // The atlas_server repeats the last one of each robot in turn: only one that is new here tells that it gets further.
  const auto& looked_at = follower.looked_at;
  const bool is_next = state.last_keyframe.IsValid() &&
                       std::find(looked_at.begin(), looked_at.end(), state.last_keyframe) == looked_at.end();
  if (is_new || is_next || follower.is_busy != state.is_busy) follower.changed_s = now_s;
  if (is_next) follower.looked_at.push_back(state.last_keyframe);
  if (follower.looked_at.size() > kRemembered) follower.looked_at.pop_front();
  follower.is_busy = state.is_busy;
  follower.heard_s = now_s;
}

bool FollowerWatch::AreDone(KeyFrameId last_keyframe, double now_s) const {
  for (const auto& [process, follower] : followers_) {
    if (now_s - follower.heard_s > kPatienceS) continue;
    if (follower.is_busy) return false;
    const auto& looked_at = follower.looked_at;
    if (!last_keyframe.IsValid() || looked_at.empty() || now_s - follower.changed_s > kStalledS) continue;
    if (std::find(looked_at.begin(), looked_at.end(), last_keyframe) == looked_at.end()) return false;
  }
  return true;
}

}  // namespace portolan
