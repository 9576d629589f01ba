#pragma once

#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <unordered_map>

#include "map/map.h"

namespace portolan {

/// Asks a map's owner for its whole state.
struct SnapshotRequest {
  MapId map;
  Revision have_revision = 0;              ///< what the asker holds
  std::vector<KeyFrameId> have_keyframes;  ///< keyframe data that need not be sent again
  ProcessId asker;
};

/// A copy of one map that follows its owner's deltas. Deltas and keyframe data may come in any order and more than
/// once. On a gap, a wrong base, a new epoch with another history or data that does not come, it asks for a snapshot.
/// Deltas of an older epoch are ignored and counted. Not thread-safe: its owner feeds it at safe points.
class MapReplica {
 public:
  explicit MapReplica(MapId id) : map_(id) {}

  const Map& map() const { return map_; }

  /// Data is kept also for keyframes not in the map yet (the tracker's own, published but not yet inserted).
  void AddKeyFrameData(std::shared_ptr<const KeyFrameData> data);
  std::shared_ptr<const KeyFrameData> FindKeyFrameData(KeyFrameId id) const;
  const std::map<KeyFrameId, std::shared_ptr<const KeyFrameData>>& keyframe_data() const { return data_; }
  /// Goes on without a keyframe's orientations and descriptors, which are kept elsewhere. No effect for an unknown one.
  void DropAppearance(KeyFrameId id);
  /// Goes on with the whole data of a keyframe again. No effect for an unknown one.
  void RestoreAppearance(std::shared_ptr<const KeyFrameData> data);
  /// Forgets data that is not in the map.
  void DropKeyFrameData(KeyFrameId id);

  /// Queues a delta (bounded; see kMaxWaiting). One that several whole states of the map were no help to is given up:
  /// what it builds on is not the owner's, or comes with the next state.
  void AddDelta(MapDelta delta);
  /// Applies what can be applied now. @return the deltas applied, in order: for what hangs on the map (tracker's
  /// matches, anchors). A snapshot lists as removed the keyframes that the replica had and it has not.
  /// @param elsewhere where data of keyframes is looked for that is not here (another map's replica, of which this map
  /// takes keyframes in: they were published once, and need not come again). May be null.
  std::vector<MapDelta> ApplyPending(const Map::FindData& elsewhere = nullptr);

  /// True while a delta waits that does not fit. Keyframe data often follows its delta by a moment: the caller sends
  /// MakeRequest() when this has held for a while (kPatienceMs), and not more often than that.
  static constexpr int kPatienceMs = 300;
  bool NeedsSnapshot() const { return needs_snapshot_; }
  SnapshotRequest MakeRequest(ProcessId asker) const;

  struct Counters {
    uint64_t applied = 0, stale_epoch = 0, repeated = 0, rejected = 0, gaps = 0, overflow = 0;
  };
  const Counters& counters() const { return counters_; }
  /// Why the last delta that could not be applied was not, in words.
  const std::string& last_problem() const { return last_problem_; }
  size_t waiting() const { return waiting_.size(); }

 private:
  struct Waiting {
    MapDelta delta;
    int snapshots_outlived = 0;  ///< states of the map that came meanwhile, and it still did not fit
  };
  bool IsOutdated(const MapDelta& delta);
  bool Fits(const MapDelta& delta) const;
  bool TryApply(MapDelta* delta, const Map::FindData& elsewhere);

  void GiveUpOutlived();

  static constexpr size_t kMaxWaiting = 256;
  static constexpr int kMaxOutlived = 4;
  Map map_;
  std::map<KeyFrameId, std::shared_ptr<const KeyFrameData>> data_;
  std::deque<Waiting> waiting_;
  bool needs_snapshot_ = false;
  std::string last_problem_;
  Counters counters_;
};

}  // namespace portolan
