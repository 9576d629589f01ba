#pragma once

#include <deque>
#include <functional>
#include <unordered_map>

#include "base/ids.h"
#include "geometry/sim3.h"
#include "map/map.h"
#include "map/protocol.h"

namespace portolan {

/// Maps that were taken into others, for keyframes that a tracker, which has not heard of it, still makes in them.
class FusedMaps {
 public:
  /// `other` as it was goes into a map.
  void Note(const Map& other, MapId map, const Sim3d& map_from_other);

  /// Makes a tracked keyframe of a fused map one of the map that has it now: its pose keeps its relation to its
  /// reference keyframe, wherever that lies now; ids of keyframes and points are the same. Others are left alone.
  /// @param find the maps as they are now, null where there is none.
  /// @return whether it was one.
  bool Redirect(const std::function<const Map*(MapId)>& find, KeyFrameMessage* message) const;

 private:
  static constexpr size_t kMaxKept = 8;  // a tracker goes over within seconds
  struct Fused {
    MapId other, map;
    Sim3d map_from_other;
    std::unordered_map<KeyFrameId, Rigid3d> poses;  // camera_from_other, at the end
  };
  const Fused* Find(MapId other) const;

  std::deque<Fused> fused_;
};

}  // namespace portolan
