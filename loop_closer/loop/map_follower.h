#pragma once

#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "map/protocol.h"
#include "map/replica_set.h"
#include "vocabulary/keyframe_index.h"

namespace portolan {

/// Keeps replicas of the maps with an index of their keyframes by visual word: what loop closing looks for places in.
/// Pure: no DDS, no threads; one thread uses it.
///
///   MapFollower follower(vocabulary);
///   follower.AddKeyFrame(message);  follower.AddChunk(chunk);  follower.OnMapperState(state);
///   for (const MapDelta& delta : follower.ApplyPending()) ...   // each new keyframe of it is in the index
class MapFollower {
 public:
  /// @param vocabulary may be null: then no keyframe has words (tests of the replicas alone).
  explicit MapFollower(std::shared_ptr<const Vocabulary> vocabulary) : vocabulary_(std::move(vocabulary)) {}

  /// @return false for one made with another vocabulary, or of no map.
  bool AddKeyFrame(const KeyFrameMessage& message);
  void AddChunk(MapDeltaChunk chunk) { replicas_.AddChunk(std::move(chunk)); }
  void OnMapperState(const MapperState& state);
  /// The same for what a status tells, which comes again and again: for maps that began before this process.
  void OnStatus(const ProcessStatus& status);

  /// Applies what can be applied and brings the index up to date. @return the deltas applied, in order.
  std::vector<MapDelta> ApplyPending();
  /// See ReplicaSet.
  std::vector<SnapshotRequest> DueRequests(double now_s, ProcessId asker) {
    return replicas_.DueRequests(now_s, asker);
  }

  struct Summary {
    MapId map;
    Epoch epoch = 0;
    Revision revision = 0, lag = 0;  ///< lag: revisions behind what the mapper announced
    size_t keyframes = 0, points = 0;
    size_t covisibility_edges = 0;  ///< pairs of keyframes with common points
  };
  /// Of a map with a revision. Time grows with the edges of the covisibility graph.
  Summary Summarize(MapId map) const;
  /// Maps with a revision, by id.
  std::vector<MapId> Maps() const;
  /// The map that changed last; none at first.
  MapId active_map() const { return active_map_; }
  /// By map, of the replicas as they are: equal to the owner's for an equal map.
  std::map<MapId, uint64_t> Hashes() const;

  const Map& map(MapId id) const { return replicas_.replicas().at(id).map(); }
  const KeyFrameIndex& index() const { return index_; }
  MapReplica::Counters counters() const { return replicas_.counters(); }

 private:
  std::shared_ptr<const Vocabulary> vocabulary_;
  ReplicaSet replicas_;
  KeyFrameIndex index_;  // of all maps
  MapId active_map_;
};

}  // namespace portolan
