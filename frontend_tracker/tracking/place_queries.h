#pragma once

#include <cstdint>
#include <optional>

#include "base/time.h"

namespace portolan {

/// When a tracker that knows no map where it is asks the atlas_server whether it knows the place, and when, at the
/// start of a run, it stops waiting for that and begins a map of its own. Time is that of the frames.
class PlaceQueries {
 public:
  static constexpr double kIntervalS = 1.0;
  static constexpr double kPatienceS = 2.0;  ///< for an answer
  static constexpr int kDenials = 3;         ///< "no" so often: the place is unknown

  /// The atlas_server said how many maps with keyframes it holds.
  void NoteMapsInAtlas(size_t number) { maps_in_atlas_ = number; }
  size_t maps_in_atlas() const { return maps_in_atlas_; }

  bool IsDue(Timestamp now) const;
  void NoteSent(Timestamp now);
  /// @param found the command to go there follows.
  void OnReply(bool found);

  /// Whether a first map may begin: there is nothing else to hope for.
  bool MayBegin(Timestamp now) const;

 private:
  size_t maps_in_atlas_ = 0;
  int denials_ = 0;
  std::optional<Timestamp> last_sent_;
  std::optional<Timestamp> unanswered_since_;
};

}  // namespace portolan
