#pragma once

#include <map>
#include <memory>
#include <optional>
#include <vector>

#include "map/map_replica.h"

namespace portolan {

/// Follows every map that comes along, for a process that owns none: a replica each, chunks put together, snapshots
/// asked for when something stays missing. Time is given in seconds of any steady clock. Not thread-safe.
/// Whoever invents maps fills no memory: of maps that nothing has come of but keyframes and announcements kMaxEmptyMaps
/// are kept, those heard of last, and of all kMaxMaps.
///
///   ReplicaSet replicas;
///   replicas.AddKeyFrameData(message.map, data);  replicas.AddChunk(chunk);
///   for (const MapDelta& delta : replicas.ApplyPending()) ...                       // what changed, map by map
///   for (const SnapshotRequest& request : replicas.DueRequests(now_s, process)) ... // a few times a second
class ReplicaSet {
 public:
  void AddKeyFrameData(MapId map, std::shared_ptr<const KeyFrameData> data);
  /// See MapReplica. Of a map that is known.
  void DropAppearance(MapId map, KeyFrameId keyframe) { replicas_.at(map).DropAppearance(keyframe); }
  void RestoreAppearance(MapId map, std::shared_ptr<const KeyFrameData> data) {
    replicas_.at(map).RestoreAppearance(std::move(data));
  }
  /// A whole delta, as from a store.
  void AddDelta(MapDelta delta);
  void AddChunk(MapDeltaChunk chunk);
  /// Someone says that the map has come so far: one that stays behind has lost its last deltas, or come late, and asks.
  void Announce(MapId map, Epoch epoch, Revision revision);

  /// Applies what can be applied, of all maps; a map finds the data of keyframes that came from another in that one's
  /// replica. @return the deltas applied, in order (see MapReplica::ApplyPending).
  std::vector<MapDelta> ApplyPending();

  /// Hands out the replica of a map, to be gone on with elsewhere; it is forgotten here. None if there is none.
  std::optional<MapReplica> Take(MapId map);
  /// Goes on with a replica that was made elsewhere, of a map that is not followed here.
  void Put(MapReplica replica);
  /// Forgets a map that is of no interest any more; what comes of it later is followed again.
  void Forget(MapId map);
  /// Forgets a map that is no more: what still comes of it is ignored, up to the last epoch that was heard of here.
  /// Does no harm to an unknown one.
  void Remove(MapId map);
  /// The same for a map that was taken into another: its keyframe data passes on, for the delta that will name it.
  void Remove(MapId map, MapId taken_into);
  /// Whether what comes of the map in this epoch (0: in none that is known) is ignored.
  bool IsRemoved(MapId map, Epoch epoch) const;
  /// The last epoch that is ignored of a map that is no more: one that comes back begins above it. 0: none.
  Epoch RemovedEpoch(MapId map) const;

  /// Requests for maps that have waited for long enough; for each once a second at most, and less often where whole
  /// states do not help (an announcement of what the owner does not have).
  std::vector<SnapshotRequest> DueRequests(double now_s, ProcessId asker);

  const std::map<MapId, MapReplica>& replicas() const { return replicas_; }
  /// Whether nothing of the map is known, here or by announcement.
  bool IsEmpty(MapId map) const;
  /// Revisions that the map is behind what was announced; 0 across epochs.
  Revision Lag(MapId map) const;
  /// Whether its owner has announced more of the map, or another epoch of it, than is here.
  bool IsBehind(MapId map) const;
  /// Sums over all replicas, those that are forgotten too; rejected has what came of maps beyond kMaxMaps.
  MapReplica::Counters counters() const;

  /// Data kept of each map that is in no delta yet, the newest; frames that were offered to begin a map and refused are
  /// in none ever.
  static constexpr size_t kMaxUnusedData = 32;
  /// The same where a whole state is expected, whose data comes ahead of it, and of all maps together: more keyframes
  /// than any one map has. Whoever announces what never comes fills no memory either.
  static constexpr size_t kMaxExpectedData = 8192;
  /// A robot has one or two that begin.
  static constexpr size_t kMaxEmptyMaps = 64;
  static constexpr size_t kMaxMaps = 4096;
  /// A delta overtaken by another fits within MapReplica::kPatienceMs; what was announced may wait in a busy owner's or
  /// reader's queue.
  static constexpr double kAnnouncedPatienceS = 2.0;
  static constexpr double kRequestIntervalS = 1.0;
  static constexpr double kMaxRequestIntervalS = 8.0;

 private:
  struct Watch {
    Epoch epoch = 0;
    Revision revision = 0;  ///< announced, in that epoch
    std::optional<double> gap_since;
    std::optional<double> behind_since;
    double last_request_s = -kMaxRequestIntervalS;
    int requests = 0;         ///< in a row, without the map having been whole
    uint64_t last_heard = 0;  ///< number of a call
  };

  /// Null if there are too many.
  MapReplica* Replica(MapId map);
  void ForgetLongestUnheardEmptyMap();
  std::shared_ptr<const KeyFrameData> FindKeyFrameData(KeyFrameId id) const;
  size_t NumUnusedData() const;
  /// Forgets the oldest, but for `kept`.
  static void DropUnusedData(size_t kept, MapReplica* replica);
  bool IsBehind(const Map& map, const Watch& watch) const;

  std::map<MapId, MapReplica> replicas_;
  std::map<MapId, Watch> watches_;
  std::map<MapId, Epoch> removed_;  // with the last epoch heard of
  DeltaAssembler assembler_;
  uint64_t heard_ = 0;
  MapReplica::Counters other_counters_;  // of replicas that are forgotten, and of maps that were refused
};

}  // namespace portolan
