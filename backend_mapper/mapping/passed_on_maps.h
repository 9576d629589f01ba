#pragma once

#include <deque>
#include <memory>
#include <vector>

#include "base/ids.h"
#include "map/map.h"
#include "map/map_replica.h"

namespace portolan {

/// Keyframe data of the last maps that passed on to another owner: when one comes back, as when a tracker goes to and
/// fro between two maps, its structure is all that is asked for.
class PassedOnMaps {
 public:
  static constexpr size_t kMaxMaps = 2;  // some 80 kB a keyframe

  void Keep(const Map& map);
  /// Gives what is kept of the replica's map to it, and keeps it no longer.
  void Return(MapReplica* replica);
  void Forget(MapId map);

 private:
  struct Kept {
    MapId map;
    std::vector<std::shared_ptr<const KeyFrameData>> keyframes;
  };
  std::deque<Kept> kept_;  // newest last
};

}  // namespace portolan
