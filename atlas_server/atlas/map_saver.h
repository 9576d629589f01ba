#pragma once

#include <functional>
#include <map>
#include <memory>
#include <utility>
#include <vector>

#include "atlas/map_store.h"
#include "map/map_replica.h"

namespace portolan {

/// Brings maps to the store as they grow, a bounded piece at a time: first the data of new keyframes, then, at most
/// every `interval_s`, the state of the map. What fails is tried again at the next step.
class MapSaver {
 public:
  /// @param store must outlive this.
  MapSaver(MapStore* store, double interval_s) : store_(*store), interval_s_(interval_s) {}

  /// What is in the store already.
  void Restore(MapId map, Epoch epoch, Revision revision) { saved_[map].state = {epoch, revision}; }

  /// One piece: at most kKeyFramesAStep keyframes, or the state of one map. Time of any steady clock.
  Status Step(const std::map<MapId, MapReplica>& replicas, double now_s) { return Step(replicas, now_s, interval_s_); }

  /// All that is not stored yet, now. @param between is called after each piece. Stops at the first failure.
  Status SaveAll(const std::map<MapId, MapReplica>& replicas, double now_s, const std::function<void()>& between);

  /// Keyframes stored since the last call, with the map they were stored for: their appearance need not be kept in
  /// memory.
  std::vector<std::pair<MapId, KeyFrameId>> TakeStored() { return std::exchange(stored_, {}); }

  /// Whether all of the map is stored as it is now.
  bool IsSaved(const Map& map) const;
  /// Whether a state of the map from this revision on is stored.
  bool HasSaved(MapId map, Revision revision) const {
    const auto saved = saved_.find(map);
    return saved != saved_.end() && saved->second.state.second >= revision;
  }
  /// The map is no more.
  void Forget(MapId map) { saved_.erase(map); }

  /// Whether the newest state of every map is stored.
  bool IsComplete(const std::map<MapId, MapReplica>& replicas) const;

  /// 2 MB, some 20 ms with compression and a flush to the disk.
  static constexpr size_t kKeyFramesAStep = 20;

 private:
  using State = std::pair<Epoch, Revision>;
  struct Saved {
    State state{0, 0};
    double time_s = 0;  ///< of the last attempt
  };

  Status Step(const std::map<MapId, MapReplica>& replicas, double now_s, double interval_s);
  static State StateOf(const Map& map) { return {map.epoch(), map.revision()}; }
  Status SaveKeyFrames(const Map& map, const std::vector<std::shared_ptr<const KeyFrameData>>& keyframes);
  Status SaveState(const Map& map, double now_s);

  MapStore& store_;
  double interval_s_;
  std::map<MapId, Saved> saved_;
  std::vector<std::pair<MapId, KeyFrameId>> stored_;
};

}  // namespace portolan
