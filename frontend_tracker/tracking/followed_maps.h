#pragma once

#include <map>
#include <memory>
#include <set>
#include <vector>

#include "map/map_replica.h"
#include "vocabulary/keyframe_index.h"

namespace portolan {

/// The tracker's replicas of maps, each with an index of its keyframes' words: the map it is in, those it was in and
/// those it is to go to. What comes of other maps is ignored.
class FollowedMaps {
 public:
  /// Begins to follow a map. @param exists it has a history: its state is to be asked for. No effect if it is followed
  /// already.
  void Follow(MapId map, bool exists);
  void Drop(MapId map);
  bool Has(MapId map) const { return replicas_.count(map) == 1; }
  /// Null if it is not followed.
  const Map* Find(MapId map) const;
  /// The same for one that is followed; a check fails otherwise.
  const Map& map(MapId map) const { return replicas_.at(map).map(); }
  const KeyFrameIndex& index(MapId map) const { return indices_.at(map); }
  const std::map<MapId, MapReplica>& replicas() const { return replicas_; }

  void AddDelta(MapDelta delta);
  void AddKeyFrameData(MapId map, std::shared_ptr<const KeyFrameData> data);
  std::shared_ptr<const KeyFrameData> FindKeyFrameData(KeyFrameId id) const;

  /// Maps for which a delta waits.
  std::vector<MapId> Waiting() const;
  /// Applies what can be applied of one map; see MapReplica::ApplyPending. Keyframe data is looked for in all replicas.
  std::vector<MapDelta> ApplyPending(MapId map);
  /// Replicas that want a snapshot: those with a gap, and those of maps that existed before they were followed.
  std::vector<const MapReplica*> InNeed() const;
  /// Of these, those of which nothing has come yet: nothing is on its way that could help, so there is nothing to wait
  /// for.
  bool IsFresh(MapId map) const { return fresh_.count(map) == 1; }

 private:
  std::map<MapId, MapReplica> replicas_;
  std::map<MapId, KeyFrameIndex> indices_;
  std::set<MapId> fresh_;
};

}  // namespace portolan
