#pragma once

#include <map>
#include <optional>
#include <vector>

#include "base/ids.h"

namespace portolan {

/// Which of the keyframes that no delta has contained yet are to be sent again, and when. What DDS still has on its way
/// is left to it: sent again it would come twice, over a link that is slow or cut as it is. Time is in seconds of any
/// steady clock.
class KeyFrameResend {
 public:
  /// Many times what a mapper takes for a keyframe; doubled with each time it is sent again, up to kMostPatienceS.
  static constexpr double kPatienceS = 2.0, kMostPatienceS = 16.0;
  /// With the mapper heard of and readers that don't acknowledge: one of them has stopped.
  static constexpr double kUndeliveredS = 10.0;
  static constexpr int kMaxTimes = 4;   ///< for one that is not awaited: its map may be nobody's any more
  static constexpr size_t kBatch = 16;  ///< keyframes at a time; the next when DDS has delivered them

  /// A keyframe went out for the first time.
  void OnSent(KeyFrameId id, double now_s);
  void OnMapperHeard(double now_s) { heard_s_ = now_s; }
  /// Another process maps now: what the one before was sent went with it.
  void OnNewMapper();

  /// @param unacknowledged  rising.
  /// @param awaited         the one whose answer the tracker waits for; none if it waits for none.
  /// @param is_delivered    every reader has acknowledged all that was written.
  /// @return those to be sent now, noted as sent.
  std::vector<KeyFrameId> Take(const std::vector<KeyFrameId>& unacknowledged, std::optional<KeyFrameId> awaited,
                               bool is_delivered, double now_s);

 private:
  struct Sent {
    double last_s = 0;
    int times_again = 0;
  };
  std::map<KeyFrameId, Sent> sent_;
  double last_send_s_ = 0;
  double heard_s_ = 0;
  bool is_new_mapper_ = false;  // and has not been sent all yet
};

}  // namespace portolan
