#pragma once

#include <map>
#include <memory>
#include <optional>
#include <vector>

#include "map/held_map.h"
#include "map/protocol.h"
#include "map/replica_set.h"

namespace portolan {

/// The maps of a robot's mapper as replicas, for one that stands by behind it: what the other owns is here, so that it
/// can be gone on with at once. Pure: no DDS, no threads; one thread uses it. Time is given in seconds of any steady
/// clock.
///
///   WarmMaps maps(self);
///   maps.OnCommand(command);  maps.OnMapperState(state);  maps.AddKeyFrame(map, data);  maps.AddChunk(chunk);
///   for (const SnapshotRequest& request : maps.Update(now_s)) ...
///   if (auto replica = maps.Take(map)) ...   // granted to this process
class WarmMaps {
 public:
  explicit WarmMaps(ProcessId self) : self_(self) {}

  /// Who owns what; maps that are no more.
  void OnCommand(const Command& command);
  void OnMapperState(const MapperState& state);
  void AddKeyFrame(MapId map, const KeyFrameData& data);
  void AddChunk(MapDeltaChunk chunk);
  /// Applies what came. @return what is missing, to be asked for.
  std::vector<SnapshotRequest> Update(double now_s);

  /// Whether it is the owner of one of the maps.
  bool IsOwner(ProcessId process) const;

  /// The replica of a map, which is followed no longer; none if nothing of it is here.
  std::optional<MapReplica> Take(MapId map);

  /// What is here of each map that differs from what the last call told.
  std::vector<HeldMap> TakeNews();
  /// The next call tells all again.
  void TellAllAgain() { told_.clear(); }

  /// The map that changed last; null if there is none.
  const Map* current() const;
  /// Revisions behind what the mapper announced, of the map that is furthest behind.
  Revision Lag() const;
  /// Maps of which something was announced and nothing is here.
  size_t num_missing() const;
  size_t num_maps() const { return replicas_.replicas().size(); }

 private:
  bool IsFollowed(MapId map) const { return followed_.count(map) == 1; }
  void Forget(MapId map);

  ProcessId self_;
  std::map<MapId, ProcessId> followed_;  // with their owners
  ReplicaSet replicas_;
  MapId current_;
  std::map<MapId, std::pair<Epoch, Revision>> told_;
};

}  // namespace portolan
