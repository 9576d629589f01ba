#include "tracking/keyframe_resend.h"

#include <algorithm>
#include <cmath>

namespace portolan {

void KeyFrameResend::OnSent(KeyFrameId id, double now_s) {
  sent_[id] = {now_s, 0};
  last_send_s_ = now_s;
}

void KeyFrameResend::OnNewMapper() {
  sent_.clear();
  is_new_mapper_ = true;
}

std::vector<KeyFrameId> KeyFrameResend::Take(const std::vector<KeyFrameId>& unacknowledged,
                                             std::optional<KeyFrameId> awaited, bool is_delivered, double now_s) {
  for (auto next = sent_.begin(); next != sent_.end();) {
    next = std::binary_search(unacknowledged.begin(), unacknowledged.end(), next->first) ? std::next(next)
                                                                                         : sent_.erase(next);
  }
  const bool is_stuck = now_s - heard_s_ < kPatienceS && now_s - last_send_s_ >= kUndeliveredS;
  if (!is_new_mapper_ && !is_delivered && !is_stuck) return {};
  std::vector<KeyFrameId> due;
  for (const KeyFrameId id : unacknowledged) {
    const auto [entry, is_unsent] = sent_.try_emplace(id);
    Sent& sent = entry->second;
    const double patience_s = std::min(kMostPatienceS, std::ldexp(kPatienceS, sent.times_again));
    if (!is_unsent && (now_s - sent.last_s < patience_s || (sent.times_again >= kMaxTimes && awaited != id))) continue;
    sent.times_again += is_unsent ? 0 : 1;
    sent.last_s = now_s;
    last_send_s_ = now_s;
    due.push_back(id);
    if (due.size() == kBatch) return due;
  }
  is_new_mapper_ = false;
  return due;
}

}  // namespace portolan
