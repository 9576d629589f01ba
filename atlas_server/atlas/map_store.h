#pragma once

#include <functional>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "atlas/atlas.h"
#include "atlas/sqlite.h"
#include "map/keyframe.h"
#include "map/map_delta.h"

namespace portolan {

/// The atlas on disk: one SQLite file with the data of each keyframe, the newest state of each map, and who was granted
/// what. What a Save... has returned Ok for is there after a crash of the program or the machine. Every error names the
/// file. One process has the file open at a time.
///
/// Schema 1 (application_id "PTLN", user_version 1):
///   keyframe(id, data)                      data: EncodeKeyFrameData, zstd
///   map(id, epoch, revision, state)         state: EncodeSnapshot, zstd; its keyframes are in keyframe
///   ownership(map, robot, epoch, owner)     of every map ever granted
class MapStore {
 public:
  /// Opens a store or makes a new one. Fails on a file of another kind, of a newer schema, damaged, locked by another
  /// process or not writable.
  static Result<std::unique_ptr<MapStore>> Open(const std::string& path);

  /// A map as it was stored: its state from revision 0, and the data of its keyframes (without derived fields).
  struct StoredMap {
    MapDelta snapshot;
    std::vector<KeyFrameData> keyframes;
  };
  struct Content {
    std::vector<StoredMap> maps;               ///< by id
    std::vector<Atlas::Ownership> ownerships;  ///< by map
    std::vector<std::string> problems;         ///< maps that are damaged and left out, and why; they stay in the file
  };
  /// Fails when the file as a whole can't be read.
  Result<Content> Load();

  /// The data of one keyframe, without derived fields.
  Result<KeyFrameData> LoadKeyFrame(KeyFrameId id);

  /// All of them or, on failure, none. Data that is there already is passed over; data without appearance is a failure.
  Status SaveKeyFrames(const std::vector<std::shared_ptr<const KeyFrameData>>& keyframes);
  /// Replaces the map's state, and drops keyframes that were in the last one and are not in this. All keyframes must
  /// have been saved.
  Status SaveMap(const MapDelta& snapshot);
  Status SaveOwnership(const Atlas::Ownership& ownership);

  bool HasKeyFrame(KeyFrameId id) const { return keyframes_.count(id) == 1; }
  size_t num_keyframes() const { return keyframes_.size(); }
  const std::string& path() const { return path_; }

 private:
  MapStore(std::string path, SqlDatabase database) : path_(std::move(path)), database_(std::move(database)) {}

  Status Prepare();
  Status CheckOrigin();
  Status MakeSchema();
  Status InTransaction(const std::function<Status()>& work);
  Status ReadKeyFrameIds();
  /// Keyframes of the map's stored state that are in no map once the snapshot is.
  std::vector<KeyFrameId> Vanished(const MapDelta& snapshot) const;
  Status Remove(const std::vector<KeyFrameId>& keyframes);
  Result<StoredMap> Decode(std::string_view state);
  Result<KeyFrameData> ReadKeyFrame(KeyFrameId id);
  Status LoadMaps(Content* content);
  Status LoadOwnerships(Content* content);
  Error At(const Error& error) const { return Error{"atlas store '" + path_ + "': " + error.message}; }

  std::string path_;
  SqlDatabase database_;
  std::set<KeyFrameId> keyframes_;                    // stored
  std::map<MapId, std::vector<KeyFrameId>> members_;  // of the stored state of each map, sorted
};

}  // namespace portolan
