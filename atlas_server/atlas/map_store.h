#pragma once

#include <functional>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "atlas/atlas.h"
#include "atlas/map_graph.h"
#include "atlas/sqlite.h"
#include "map/keyframe.h"
#include "map/map_delta.h"
#include "map/map_file.h"

namespace portolan {

/// The atlas on disk: one SQLite file with the data of each keyframe, the newest state of each map, and who was granted
/// what. What a Save... has returned Ok for is there after a crash of the program or the machine. Every error names the
/// file. One process has the file open at a time.
///
/// Schema 3 (application_id "PTLN", user_version 3):
///   keyframe(id, data)                      data: EncodeKeyFrameData, zstd
///   map(id, epoch, revision, state)         state: EncodeSnapshot, zstd; its keyframes are in keyframe
///   change(map, revision, delta)            what came after the map's state, each from the revision before to this:
///                                           EncodeChange, zstd; what a map has is its state with its changes
///   ownership(map, robot, epoch, owner)     of every map ever granted and not deleted
///   graph_map(id), link(map, other, transform), fused(map, other, transform), activity(map, other, count)
///                                           the map graph; transform: map_from_other (graph_tables.h)
/// Each blob has a hash over its content in it, which is verified when it is read; a blob that is damaged is left out
/// and named; a map with a damaged change is as it was before that. Schema 1 had no map graph, schema 2 no changes; a
/// file of them becomes one of schema 3, at once or not at all, when it is opened.
class MapStore {
 public:
  /// Opens a store or makes a new one. Fails on a file of another kind, of a newer schema, damaged, locked by another
  /// process or not writable.
  static Result<std::unique_ptr<MapStore>> Open(const std::string& path);

  /// Whether Open() failed because another process has the file open.
  static bool IsInUse(const Error& error);

  using StoredMap = portolan::StoredMap;
  using Link = MapGraph::Link;
  using Activity = MapGraph::Activity;
  using Fused = MapGraph::Fused;
  using Graph = MapGraph::State;
  struct Content {
    std::vector<StoredMap> maps;               ///< by id
    std::vector<Atlas::Ownership> ownerships;  ///< by map
    Graph graph;                               ///< by map and other
    /// Maps and links that are damaged and left out, and why; they stay in the file.
    std::vector<std::string> problems;
  };
  /// Fails when the file as a whole can't be read.
  Result<Content> Load();
  /// The same but for the maps, which LoadEachMap() has: they need not be in memory all at a time.
  Result<Content> LoadWithoutMaps();
  /// Calls take(map) for each map, in order of id, as soon as it is read. @param problems gets what is damaged and left
  /// out.
  Status LoadEachMap(const std::function<void(StoredMap map)>& take, std::vector<std::string>* problems);

  /// One map, as Load() has it.
  Result<StoredMap> LoadMap(MapId id);
  /// Its state alone: whoever has more to do meanwhile loads the keyframes one by one.
  Result<MapDelta> LoadState(MapId id);
  /// The data of one keyframe, without derived fields.
  Result<KeyFrameData> LoadKeyFrame(KeyFrameId id);

  /// All of them or, on failure, none. Data that is there already is passed over; data without appearance is a failure.
  Status SaveKeyFrames(const std::vector<std::shared_ptr<const KeyFrameData>>& keyframes);
  /// Replaces the map's state and its changes, and drops keyframes that were in them and are not in this. All keyframes
  /// must have been saved.
  Status SaveMap(const MapDelta& snapshot);
  /// Whether the change can be stored as one: it goes on from what is stored of its map (after Load() or
  /// LoadEachMap()).
  bool CanAppend(const MapDelta& change) const;
  /// Adds changes to what is stored of a map: all or, on failure, none. The first one CanAppend(), each other goes on
  /// from the one before, and all keyframes in them must have been saved.
  Status SaveChanges(const std::vector<MapDelta>& changes);
  /// How much a map's state and its changes take; 0 for a map that is not stored.
  struct Sizes {
    size_t state_bytes = 0, change_bytes = 0;
  };
  Sizes SizesOf(MapId id) const;
  Status SaveOwnership(const Atlas::Ownership& ownership);
  /// Replaces the map graph as a whole.
  Status SaveGraph(const Graph& graph);
  /// Drops a map with its ownership, its part of the map graph (but not that it went into another), and those of its
  /// keyframes that are in no other map. No effect for a map that is not there.
  Status DeleteMap(MapId id);
  /// Writes one map into a file of its own (map/map_file.h).
  Status ExportMap(MapId id, const std::string& path);

  bool HasKeyFrame(KeyFrameId id) const { return keyframes_.count(id) == 1; }
  /// Whether a state of the map is stored; after Load() or LoadEachMap().
  bool HasMap(MapId id) const { return maps_.count(id) == 1; }
  /// Whether there is a state of the map that can't be read; after Load() or LoadEachMap().
  bool IsDamaged(MapId id) const { return damaged_.count(id) == 1; }
  size_t num_keyframes() const { return keyframes_.size(); }
  const std::string& path() const { return path_; }

 private:
  MapStore(std::string path, SqlDatabase database) : path_(std::move(path)), database_(std::move(database)) {}

  /// What is known of a map in the file.
  struct Stored {
    Epoch epoch = 0;
    Revision revision = 0;
    Sizes sizes;
    std::vector<KeyFrameId> members;  ///< keyframes in its state or its changes, sorted
    bool is_cut = false;              ///< a change is damaged: none may follow
  };

  Status Prepare();
  Status CheckOrigin();
  Status MakeSchema();
  Status Migrate(uint64_t from);
  Status InTransaction(const std::function<Status()>& work);
  Status ReadKeyFrameIds();
  /// Keyframes of the map's stored state that are in no map once it has only `staying`.
  std::vector<KeyFrameId> Vanished(MapId map, const std::vector<KeyFrameId>& staying) const;
  Status Remove(const std::vector<KeyFrameId>& keyframes);
  /// What is stored of a map, read.
  struct State {
    MapDelta snapshot;  ///< with the changes
    Sizes sizes;
    std::vector<KeyFrameId> members;
    std::string problem;  ///< what is wrong with a change: it and those behind it are left out
  };
  Result<State> ReadState(MapId id);
  Status ReadSnapshot(MapId id, State* state);
  Status ReadChanges(MapId id, State* state);
  Result<StoredMap> AddKeyFrames(MapDelta snapshot);
  Result<KeyFrameData> ReadKeyFrame(KeyFrameId id);
  Status LoadOwnerships(Content* content);
  Error At(const Error& error) const { return Error{"atlas store '" + path_ + "': " + error.message}; }

  std::string path_;
  SqlDatabase database_;
  std::set<KeyFrameId> keyframes_;  // stored
  std::map<MapId, Stored> maps_;
  std::set<MapId> damaged_;
};

}  // namespace portolan
