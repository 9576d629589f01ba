#pragma once

#include <functional>
#include <map>
#include <memory>
#include <utility>
#include <vector>

#include "atlas/map_store.h"
#include "map/map_replica.h"

namespace portolan {

/// Brings maps to the store as they grow, a bounded piece at a time: the data of new keyframes, then, at most every
/// `interval_s`, what changed in the map since. The map's whole state is written where the changes do not go on from
/// what is stored (a new map, a new owner), once they have become much beside it, and when the map rests. What fails is
/// tried again.
class MapSaver {
 public:
  /// @param store must outlive this.
  MapSaver(MapStore* store, double interval_s) : store_(*store), interval_s_(interval_s) {}

  /// What is in the store already.
  void Restore(MapId map, Epoch epoch, Revision revision) { saved_[map].state = {epoch, revision}; }

  /// A delta that was applied to the map's replica; every one.
  void OnApplied(const MapDelta& delta);

  /// One piece, maps in turns: at most kKeyFramesAStep keyframes of one map and, if those were all, its changes or its
  /// state. Time of any steady clock.
  /// @return whether there was one.
  Result<bool> Step(const std::map<MapId, MapReplica>& replicas, double now_s);

  /// All that is not stored yet, now, as whole states. @param between is called after each piece. Stops at the first
  /// failure.
  Status SaveAll(const std::map<MapId, MapReplica>& replicas, double now_s, const std::function<void()>& between);

  /// Keyframes stored since the last call, with the map they were stored for: their appearance need not be kept in
  /// memory.
  std::vector<std::pair<MapId, KeyFrameId>> TakeStored() { return std::exchange(stored_, {}); }

  /// Whether all of the map is stored as it is now.
  bool IsSaved(const Map& map) const;
  /// Whether a state of the map from this revision on is stored.
  bool HasSaved(MapId map, Revision revision) const {
    const auto saved = saved_.find(map);
    return saved != saved_.end() && saved->second.state != State() && saved->second.state.second >= revision;
  }
  /// The map is no more.
  void Forget(MapId map) { saved_.erase(map); }

  /// Whether the newest state of every map is stored.
  bool IsComplete(const std::map<MapId, MapReplica>& replicas) const;

  /// 2 MB, some 20 ms with compression and a flush to the disk.
  static constexpr size_t kKeyFramesAStep = 20;
  /// Changes of a map take about half of its state at most, or this where that is more: merging them when they are read
  /// stays cheap, and writing the state anew costs some twice what they did.
  static constexpr size_t kMostChangeBytes = 256 << 10;
  /// A map that did not change for so long is stored as one state: long beside the time between keyframes, so that a
  /// map that grows is not written anew in each pause.
  static constexpr double kRestS = 3;
  /// Between attempts to write a map's whole state, which takes tens of milliseconds for hundreds of keyframes.
  static constexpr double kStateIntervalS = 1;
  /// Changes that wait to be stored; beyond it the store is out of order, and the state is written when it is back.
  static constexpr size_t kMostWaiting = 256;

 private:
  using State = std::pair<Epoch, Revision>;
  struct Saved {
    State state;
    std::vector<MapDelta> waiting;  // go on from it, or none if what came does not
    double changes_s = -1e9;        // of the last attempts
    double state_s = -1e9;
  };

  /// @return whether a piece of the map was written.
  Result<bool> StepMap(const Map& map, double now_s);
  static State StateOf(const Map& map) { return {map.epoch(), map.revision()}; }
  bool MayAppend(const Map& map, const Saved& saved) const;
  bool IsStateDue(const Map& map, const Saved& saved, double now_s) const;
  std::vector<std::shared_ptr<const KeyFrameData>> MissingKeyFrames(const Map& map) const;
  Status SaveKeyFrames(const Map& map, const std::vector<std::shared_ptr<const KeyFrameData>>& keyframes);
  Status SaveChanges(const Map& map, double now_s);
  Status SaveState(const Map& map, double now_s);

  MapStore& store_;
  double interval_s_;
  std::map<MapId, Saved> saved_;
  MapId last_;  // that a piece was written of
  std::vector<std::pair<MapId, KeyFrameId>> stored_;
};

}  // namespace portolan
