#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <vector>

#include "base/ids.h"
#include "base/time.h"
#include "geometry/rigid3.h"
#include "geometry/sim3.h"
#include "map/map.h"
#include "tracking/frame.h"

namespace portolan {

/// A tracked frame for the trajectory: hung on a keyframe, so that it moves with the map when the map is corrected.
struct FrameRecord {
  uint64_t frame = 0;
  Timestamp stamp;
  MapId map;
  KeyFrameId anchor;
  Rigid3d camera_from_anchor;
  Rigid3d online_camera_from_map;  ///< as it was known when the frame was tracked
  bool online = true;              ///< false: found later, from a frame before the map's own beginning
  /// By dead reckoning (Frame); none for frames of an earlier tracker of the run.
  std::optional<Eigen::Quaterniond> camera_from_start;
};

/// Every tracked frame of a run.
class FrameHistory {
 public:
  /// @param frame tracked in `map`, its reference keyframe in it.
  void Add(const Map& map, const Frame& frame, bool online);

  /// A frame became a keyframe: once the map holds it, the frame is the keyframe.
  void NoteKeyFrame(uint64_t frame, KeyFrameId keyframe);

  /// To be called for each delta, after it was applied to `map`: records on removed keyframes pass to what these hung
  /// on, and frames that became keyframes of the map are hung on themselves.
  void OnDelta(const Map& map, const MapDelta& delta);

  /// `map` has taken in all of `other`, whose keyframes keep their ids: its frames are frames of `map` from now on.
  void Fuse(MapId map, MapId other, const Sim3d& map_from_other);
  bool Has(uint64_t frame) const { return records_.count(frame) == 1; }

  /// What an earlier tracker of the run had.
  void Restore(const std::vector<FrameRecord>& records);
  /// Frames of the map whose keyframe is not in it any more, removed between two trackers when nobody noted what hung
  /// on it, hang on what the nearest frame hangs on that has one: by the way between the two as it was tracked.
  void HangLooseFrames(const Map& map);
  /// Records that are new or hang elsewhere since the last call.
  std::vector<FrameRecord> TakeChanged();

  /// In order of frame number.
  const std::map<uint64_t, FrameRecord>& records() const { return records_; }
  /// The pose as the map has it now; none if its anchor is gone.
  static std::optional<Rigid3d> CameraFromMap(const Map& map, const FrameRecord& record);

 private:
  void PassOn(MapId map, const MapDelta::RemovedKeyFrame& removed);
  void Anchor(FrameRecord* record, KeyFrameId anchor, const Rigid3d& camera_from_anchor);

  std::map<uint64_t, FrameRecord> records_;
  std::map<KeyFrameId, std::vector<uint64_t>> by_anchor_;
  std::set<uint64_t> changed_;                // since the last TakeChanged()
  std::map<KeyFrameId, uint64_t> own_frame_;  // keyframes not in the map yet
  /// Removed from a map while frames still hung on them in the map it took in: told before the fusion itself.
  std::map<MapId, std::vector<MapDelta::RemovedKeyFrame>> removed_early_;
};

}  // namespace portolan
