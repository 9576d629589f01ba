#include "tracking/follower_watch.h"

#include <algorithm>

namespace portolan {
namespace {

constexpr size_t kRemembered = 32;  // keyframes of all robots that a follower looks at

}  // namespace

void FollowerWatch::OnState(const FollowerState& state, double now_s) {
  const auto [entry, is_new] = followers_.try_emplace(state.process);
  Follower& follower = entry->second;
  const bool is_next =
      state.last_keyframe.IsValid() && (follower.looked_at.empty() || follower.looked_at.back() != state.last_keyframe);
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
