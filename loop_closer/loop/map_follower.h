#pragma once

#include <deque>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "map/protocol.h"
#include "map/replica_set.h"
#include "vocabulary/keyframe_index.h"

namespace portolan {

/// Keeps replicas of a robot's maps with an index of their keyframes by visual word: what loop closing looks for places
/// in. A robot's maps are those that its tracker makes keyframes in or is in, and that its mapper works on: of all that
/// an atlas_server and other robots talk about, the few that matter here. Pure: no DDS, no threads; one thread uses it.
///
///   MapFollower follower(vocabulary, robot);
///   follower.AddKeyFrame(message);  follower.AddChunk(chunk);  follower.OnMapperState(state);
///   for (const MapDelta& delta : follower.ApplyPending()) ...   // each new keyframe of it is in the index
class MapFollower {
 public:
  /// @param vocabulary may be null: then no keyframe has words (tests of the replicas alone).
  MapFollower(std::shared_ptr<const Vocabulary> vocabulary, RobotId robot)
      : vocabulary_(std::move(vocabulary)), robot_(robot) {}

  /// Of maps that go back and forth between being active and dormant the last ones are followed; of more the one that
  /// mattered least recently is forgotten.
  static constexpr size_t kMaxFollowed = 8;
  /// @param epoch in which it was heard of, 0 if unknown: a map that is no more may come back in a later one.
  void Follow(MapId map, Epoch epoch = 0);
  bool IsFollowed(MapId map) const;

  /// @return false for one made with another vocabulary, or of no map.
  bool AddKeyFrame(const KeyFrameMessage& message);
  void AddChunk(MapDeltaChunk chunk);
  void OnMapperState(const MapperState& state);
  /// The same for what a status tells, which comes again and again: for maps that began before this process.
  void OnStatus(const ProcessStatus& status);
  /// Where the robot is.
  void OnTrackerState(const TrackerState& state);
  /// `map` has taken in `other`, which is no more; its keyframe data passes on. Followed on if either was.
  void Fuse(MapId map, MapId other);
  /// The map is no more.
  void Remove(MapId map);

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
  /// The map that the robot is in, as soon as it is here; before that the last one. None at first.
  MapId active_map() const { return active_map_; }
  /// Whether the map is here, and as far as its owner has announced.
  bool IsUpToDate(MapId map) const;
  /// By map, of the replicas as they are: equal to the owner's for an equal map.
  std::map<MapId, uint64_t> Hashes() const;

  /// Null if it is not here.
  const Map* Find(MapId id) const { return IsHere(id) ? &map(id) : nullptr; }
  const Map& map(MapId id) const { return replicas_.replicas().at(id).map(); }
  const KeyFrameIndex& index() const { return index_; }
  MapReplica::Counters counters() const { return replicas_.counters(); }

 private:
  bool IsHere(MapId map) const;
  void Unindex(MapId map, const Map* except);
  void ChooseActiveMap();

  std::shared_ptr<const Vocabulary> vocabulary_;
  RobotId robot_;
  std::deque<MapId> followed_;  // the one that mattered last is last
  ReplicaSet replicas_;
  KeyFrameIndex index_;  // of all maps
  MapId tracked_map_;    // as the tracker says
  MapId active_map_;
};

}  // namespace portolan
