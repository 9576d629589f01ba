#include "atlas/map_store.h"

#include <algorithm>
#include <iterator>

#include "atlas/graph_tables.h"
#include "atlas/zstd_blob.h"
#include "map/map_changes.h"
#include "map/map_io.h"

namespace portolan {
namespace {

constexpr uint64_t kApplicationId = 0x50544c4e;  // "PTLN"
constexpr uint64_t kSchema = 3;
constexpr size_t kMaxBlobBytes = 1u << 30;  // SQLite's own limit on a blob

constexpr const char* kFirstTables =  // of schema 1
    "CREATE TABLE keyframe(id INTEGER PRIMARY KEY, data BLOB NOT NULL);"
    "CREATE TABLE map(id INTEGER PRIMARY KEY, epoch INTEGER NOT NULL, revision INTEGER NOT NULL, state BLOB NOT NULL);"
    "CREATE TABLE ownership(map INTEGER PRIMARY KEY, robot INTEGER NOT NULL, epoch INTEGER NOT NULL, owner INTEGER NOT "
    "NULL);";
constexpr const char* kChangeTable =  // new in schema 3
    "CREATE TABLE change(map INTEGER NOT NULL, revision INTEGER NOT NULL, delta BLOB NOT NULL, PRIMARY KEY(map, "
    "revision));";

/// @param members sorted; gets the keyframes of a state or a change too.
void AddMembers(const MapDelta& delta, std::vector<KeyFrameId>* members) {
  for (const auto& state : delta.keyframes) members->push_back(state.id);
  std::sort(members->begin(), members->end());
  members->erase(std::unique(members->begin(), members->end()), members->end());
}

}  // namespace

Result<std::unique_ptr<MapStore>> MapStore::Open(const std::string& path) {
  Result<SqlDatabase> database = SqlDatabase::Open(path);
  if (!database) return Error{"atlas store '" + path + "': " + database.error().message};
  std::unique_ptr<MapStore> store(new MapStore(path, std::move(*database)));
  if (Status prepared = store->Prepare(); !prepared) return store->At(prepared.error());
  return store;
}

bool MapStore::IsInUse(const Error& error) {
  return error.message.find(sqlite3_errstr(SQLITE_BUSY)) != std::string::npos;
}

Status MapStore::Prepare() {
  // Exclusive: the lock is held while the store is open, and the index of the log is in memory in place of a mapped
  // file, which a full disk would turn into a bus error. Synchronous FULL: a commit is on the disk when it returns.
  if (Status set = database_.Execute("PRAGMA locking_mode = EXCLUSIVE"); !set) return set;
  if (Status checked = CheckOrigin(); !checked) return checked;
  if (Status set = database_.Execute("PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL"); !set) return set;
  // Takes the lock, and finds out whether the file can be written.
  const Status ready = InTransaction([this] { return MakeSchema(); });
  return ready ? ReadKeyFrameIds() : ready;
}

Status MapStore::CheckOrigin() {
  const Result<uint64_t> tables = database_.QueryInteger("SELECT count(*) FROM sqlite_schema");
  if (!tables) return tables.error();
  const Result<uint64_t> application = database_.QueryInteger("PRAGMA application_id");
  if (!application) return application.error();
  const Result<uint64_t> schema = database_.QueryInteger("PRAGMA user_version");
  if (!schema) return schema.error();
  if (*tables == 0 && *application == 0) return Ok{};  // new
  if (*application != kApplicationId) return Error{"an SQLite file of another program, left as it is"};
  if (*schema > kSchema) {
    return Error{"made by a newer Portolan (schema " + std::to_string(*schema) + ", this one knows " +
                 std::to_string(kSchema) + ")"};
  }
  return Ok{};
}

Status MapStore::MakeSchema() {
  const Result<uint64_t> application = database_.QueryInteger("PRAGMA application_id");
  if (!application) return application.error();
  if (*application == 0) {
    if (Status made = database_.Execute(kFirstTables); !made) return made;
    if (Status marked = database_.Execute("PRAGMA application_id = " + std::to_string(kApplicationId)); !marked)
      return marked;
    return Migrate(1);
  }
  const Result<uint64_t> schema = database_.QueryInteger("PRAGMA user_version");
  if (!schema) return schema.error();
  return Migrate(*schema);
}

/// From one schema to the next until the newest; also when nothing is to be done, as that shows that the file can be
/// written.
Status MapStore::Migrate(uint64_t from) {
  if (from < 2) {
    if (Status made = MakeGraphTables(&database_); !made) return made;
  }
  if (from < 3) {
    if (Status made = database_.Execute(kChangeTable); !made) return made;
  }
  return database_.Execute("PRAGMA user_version = " + std::to_string(kSchema));
}

Status MapStore::InTransaction(const std::function<Status()>& work) {
  if (Status begun = database_.Execute("BEGIN IMMEDIATE"); !begun) return begun;
  Status done = work();
  if (done) done = database_.Execute("COMMIT");
  if (!done) static_cast<void>(database_.Execute("ROLLBACK").ok());  // fails where SQLite has rolled back by itself
  return done;
}

Status MapStore::ReadKeyFrameIds() {
  return database_.ForEachRow("SELECT id FROM keyframe",
                              [this](const SqlStatement& row) { keyframes_.insert(KeyFrameId(row.Integer(0))); });
}

Status MapStore::SaveKeyFrames(const std::vector<std::shared_ptr<const KeyFrameData>>& keyframes) {
  std::vector<KeyFrameId> saved;
  const Status done = InTransaction([&]() -> Status {
    Result<SqlStatement> insert = database_.Prepare("INSERT OR REPLACE INTO keyframe VALUES (?1, ?2)");
    if (!insert) return insert.error();
    for (const auto& data : keyframes) {
      if (HasKeyFrame(data->id)) continue;
      if (!data->features.HasAppearance()) return Error{"keyframe " + ToString(data->id) + " has no descriptors"};
      const std::string blob = Compress(EncodeKeyFrameData(*data));
      if (Status inserted = insert->Bind(1, data->id.value).Bind(2, blob).Run(); !inserted) return inserted;
      saved.push_back(data->id);
    }
    return Ok{};
  });
  if (!done) return At(done.error());
  keyframes_.insert(saved.begin(), saved.end());
  return Ok{};
}

Status MapStore::SaveMap(const MapDelta& snapshot) {
  for (const auto& [id, pose, parent, features] : snapshot.keyframes)
    PORTOLAN_CHECK(HasKeyFrame(id)) << "keyframe " << id << " of map " << snapshot.map << " is not stored";
  Stored stored{snapshot.epoch, snapshot.revision, {}, {}, false};
  AddMembers(snapshot, &stored.members);
  const std::vector<KeyFrameId> vanished = Vanished(snapshot.map, stored.members);
  const Status done = InTransaction([&]() -> Status {
    Result<SqlStatement> clear = database_.Prepare("DELETE FROM change WHERE map = ?1");
    if (!clear) return clear.error();
    if (Status cleared = clear->Bind(1, snapshot.map.value).Run(); !cleared) return cleared;
    Result<SqlStatement> insert = database_.Prepare("INSERT OR REPLACE INTO map VALUES (?1, ?2, ?3, ?4)");
    if (!insert) return insert.error();
    const std::string blob = Compress(EncodeSnapshot(snapshot));
    stored.sizes.state_bytes = blob.size();
    insert->Bind(1, snapshot.map.value).Bind(2, snapshot.epoch).Bind(3, snapshot.revision).Bind(4, blob);
    if (Status inserted = insert->Run(); !inserted) return inserted;
    return Remove(vanished);
  });
  if (!done) return At(done.error());
  for (const KeyFrameId id : vanished) keyframes_.erase(id);
  maps_[snapshot.map] = std::move(stored);
  damaged_.erase(snapshot.map);
  return Ok{};
}

bool MapStore::CanAppend(const MapDelta& change) const {
  const auto stored = maps_.find(change.map);
  return stored != maps_.end() && !stored->second.is_cut &&
         Continues(change, stored->second.epoch, stored->second.revision);
}

Status MapStore::SaveChanges(const std::vector<MapDelta>& changes) {
  if (changes.empty()) return Ok{};
  PORTOLAN_CHECK(CanAppend(changes.front()))
      << "change of map " << changes.front().map << " from revision " << changes.front().base_revision;
  const MapId map = changes.front().map;
  Stored stored = maps_.at(map);
  const Status done = InTransaction([&]() -> Status {
    Result<SqlStatement> insert = database_.Prepare("INSERT INTO change VALUES (?1, ?2, ?3)");
    if (!insert) return insert.error();
    for (const MapDelta& change : changes) {
      PORTOLAN_CHECK(change.map == map && Continues(change, stored.epoch, stored.revision))
          << "change of map " << change.map << " from revision " << change.base_revision;
      for (const auto& state : change.keyframes)
        PORTOLAN_CHECK(HasKeyFrame(state.id)) << "keyframe " << state.id << " of map " << map << " is not stored";
      const std::string blob = Compress(EncodeChange(change));
      if (Status inserted = insert->Bind(1, map.value).Bind(2, change.revision).Bind(3, blob).Run(); !inserted)
        return inserted;
      stored.revision = change.revision;
      stored.sizes.change_bytes += blob.size();
      AddMembers(change, &stored.members);
    }
    return Ok{};
  });
  if (!done) return At(done.error());
  maps_[map] = std::move(stored);
  return Ok{};
}

MapStore::Sizes MapStore::SizesOf(MapId id) const {
  const auto stored = maps_.find(id);
  return stored == maps_.end() ? Sizes() : stored->second.sizes;
}

std::vector<KeyFrameId> MapStore::Vanished(MapId map, const std::vector<KeyFrameId>& staying) const {
  const auto before = maps_.find(map);
  if (before == maps_.end()) return {};
  std::set<KeyFrameId> kept(staying.begin(), staying.end());  // here or, after a fusion, in another map
  for (const auto& [other, stored] : maps_) {
    if (other != map) kept.insert(stored.members.begin(), stored.members.end());
  }
  std::vector<KeyFrameId> vanished;
  std::set_difference(before->second.members.begin(), before->second.members.end(), kept.begin(), kept.end(),
                      std::back_inserter(vanished));
  return vanished;
}

Status MapStore::Remove(const std::vector<KeyFrameId>& keyframes) {
  Result<SqlStatement> remove = database_.Prepare("DELETE FROM keyframe WHERE id = ?1");
  if (!remove) return remove.error();
  for (const KeyFrameId id : keyframes) {
    if (Status removed = remove->Bind(1, id.value).Run(); !removed) return removed;
  }
  return Ok{};
}

Status MapStore::SaveOwnership(const Atlas::Ownership& ownership) {
  const Status done = InTransaction([&]() -> Status {
    Result<SqlStatement> insert = database_.Prepare("INSERT OR REPLACE INTO ownership VALUES (?1, ?2, ?3, ?4)");
    if (!insert) return insert.error();
    insert->Bind(1, ownership.map.value)
        .Bind(2, uint64_t{ownership.robot})
        .Bind(3, ownership.epoch)
        .Bind(4, ownership.owner.value);
    return insert->Run();
  });
  if (!done) return At(done.error());
  return Ok{};
}

Status MapStore::SaveGraph(const Graph& graph) {
  const Status done = InTransaction([&] { return WriteGraph(graph, &database_); });
  if (!done) return At(done.error());
  return Ok{};
}

Status MapStore::DeleteMap(MapId id) {
  const std::vector<KeyFrameId> vanished = Vanished(id, {});
  const Status done = InTransaction([&]() -> Status {
    for (const char* sql : {"DELETE FROM map WHERE id = ?1", "DELETE FROM change WHERE map = ?1",
                            "DELETE FROM ownership WHERE map = ?1"}) {
      Result<SqlStatement> remove = database_.Prepare(sql);
      if (!remove) return remove.error();
      if (Status removed = remove->Bind(1, id.value).Run(); !removed) return removed;
    }
    if (Status removed = RemoveFromGraph(id, &database_); !removed) return removed;
    return Remove(vanished);
  });
  if (!done) return At(done.error());
  for (const KeyFrameId keyframe : vanished) keyframes_.erase(keyframe);
  maps_.erase(id);
  damaged_.erase(id);
  return Ok{};
}

Status MapStore::ExportMap(MapId id, const std::string& path) {
  const Result<StoredMap> stored = LoadMap(id);
  if (!stored) return stored.error();
  const Result<Map> map = RestoreMap(*stored, nullptr);
  if (!map) return At({"map " + ToString(id) + ": " + map.error().message});
  return WriteMapFile(path, {&*map});
}

Result<MapStore::Content> MapStore::Load() {
  Result<Content> content = LoadWithoutMaps();
  if (!content) return content;
  const auto keep = [&](StoredMap map) { content->maps.push_back(std::move(map)); };
  if (Status loaded = LoadEachMap(keep, &content->problems); !loaded) return loaded.error();
  return content;
}

Result<MapStore::Content> MapStore::LoadWithoutMaps() {
  Content content;
  if (Status loaded = LoadOwnerships(&content); !loaded) return At(loaded.error());
  std::vector<std::string> problems;
  Result<Graph> graph = ReadGraph(&database_, &problems);
  if (!graph) return At(graph.error());
  content.graph = std::move(*graph);
  for (const std::string& problem : problems) content.problems.push_back(At({problem}).message);
  return content;
}

Status MapStore::LoadOwnerships(Content* content) {
  return database_.ForEachRow(
      "SELECT map, robot, epoch, owner FROM ownership ORDER BY map", [&](const SqlStatement& row) {
        content->ownerships.push_back(
            {MapId(row.Integer(0)), static_cast<RobotId>(row.Integer(1)), row.Integer(2), ProcessId(row.Integer(3))});
      });
}

Status MapStore::LoadEachMap(const std::function<void(StoredMap map)>& take, std::vector<std::string>* problems) {
  std::vector<MapId> ids;
  const Status read = database_.ForEachRow("SELECT id FROM map ORDER BY id",
                                           [&](const SqlStatement& row) { ids.emplace_back(row.Integer(0)); });
  if (!read) return At(read.error());
  for (const MapId id : ids) {
    Result<State> state = ReadState(id);
    Result<StoredMap> map = state ? AddKeyFrames(std::move(state->snapshot)) : state.error();
    if (!map) {
      damaged_.insert(id);
      problems->push_back(At({"map " + ToString(id) + " is left out: " + map.error().message}).message);
      continue;
    }
    const MapDelta& snapshot = map->snapshot;
    const bool is_cut = !state->problem.empty();
    maps_[id] = {snapshot.epoch, snapshot.revision, state->sizes, std::move(state->members), is_cut};
    if (is_cut) {
      const std::string name = "map " + ToString(id) + " is as of revision " + std::to_string(snapshot.revision);
      problems->push_back(At({name + ": " + state->problem}).message);
    }
    take(std::move(*map));
  }
  return Ok{};
}

Result<MapStore::StoredMap> MapStore::LoadMap(MapId id) {
  Result<State> state = ReadState(id);
  Result<StoredMap> map = state ? AddKeyFrames(std::move(state->snapshot)) : state.error();
  if (!map) return At({"map " + ToString(id) + ": " + map.error().message});
  return map;
}

Result<MapDelta> MapStore::LoadState(MapId id) {
  Result<State> state = ReadState(id);
  if (!state) return At({"map " + ToString(id) + ": " + state.error().message});
  return std::move(state->snapshot);
}

Result<MapStore::State> MapStore::ReadState(MapId id) {
  State state;
  if (Status read = ReadSnapshot(id, &state); !read) return read.error();
  if (Status read = ReadChanges(id, &state); !read) return read.error();
  return state;
}

Status MapStore::ReadSnapshot(MapId id, State* state) {
  Result<SqlStatement> query = database_.Prepare("SELECT state FROM map WHERE id = ?1");
  if (!query) return query.error();
  const Result<bool> row = query->Bind(1, id.value).Step();
  if (!row) return row.error();
  if (!*row) return Error{"it is not in the store"};
  state->sizes.state_bytes = query->Blob(0).size();
  const Result<std::string> bytes = Decompress(query->Blob(0), kMaxBlobBytes);
  if (!bytes) return Error{"map state: " + bytes.error().message};
  Result<MapDelta> snapshot = DecodeSnapshot(*bytes);
  if (!snapshot) return snapshot.error();
  if (snapshot->map != id) return Error{"the state is that of map " + ToString(snapshot->map)};
  state->snapshot = std::move(*snapshot);
  AddMembers(state->snapshot, &state->members);
  return Ok{};
}

/// Fails only where the file can't be read.
Status MapStore::ReadChanges(MapId id, State* state) {
  Result<SqlStatement> query = database_.Prepare("SELECT revision, delta FROM change WHERE map = ?1 ORDER BY revision");
  if (!query) return query.error();
  query->Bind(1, id.value);
  std::vector<MapDelta> changes;
  while (state->problem.empty()) {
    const Result<bool> row = query->Step();
    if (!row) return row.error();
    if (!*row) break;
    state->sizes.change_bytes += query->Blob(1).size();
    const Result<std::string> bytes = Decompress(query->Blob(1), kMaxBlobBytes);
    Result<MapDelta> change = bytes ? DecodeChange(*bytes) : bytes.error();
    if (change) {
      AddMembers(*change, &state->members);
      changes.push_back(std::move(*change));
    } else {
      state->problem = "the change to revision " + std::to_string(query->Integer(0)) + ": " + change.error().message;
    }
  }
  Result<MapDelta> merged = MergeChanges(state->snapshot, changes);
  if (merged) {
    state->snapshot = std::move(*merged);
  } else {
    state->problem = merged.error().message;
  }
  return Ok{};
}

Result<StoredMap> MapStore::AddKeyFrames(MapDelta snapshot) {
  StoredMap map;
  for (const auto& keyframe : snapshot.keyframes) {
    Result<KeyFrameData> data = ReadKeyFrame(keyframe.id);
    if (!data) return data.error();
    map.keyframes.push_back(std::move(*data));
  }
  map.snapshot = std::move(snapshot);
  return map;
}

Result<KeyFrameData> MapStore::LoadKeyFrame(KeyFrameId id) {
  Result<KeyFrameData> data = ReadKeyFrame(id);
  if (!data) return At(data.error());
  return data;
}

Result<KeyFrameData> MapStore::ReadKeyFrame(KeyFrameId id) {
  const std::string name = "keyframe " + ToString(id);
  Result<SqlStatement> query = database_.Prepare("SELECT data FROM keyframe WHERE id = ?1");
  if (!query) return Error{name + ": " + query.error().message};
  const Result<bool> row = query->Bind(1, id.value).Step();
  if (!row) return Error{name + ": " + row.error().message};
  if (!*row) return Error{name + ": its data is not in the store"};
  const Result<std::string> bytes = Decompress(query->Blob(0), kMaxBlobBytes);
  if (!bytes) return Error{name + ": " + bytes.error().message};
  Result<KeyFrameData> data = DecodeKeyFrameData(*bytes);
  if (!data) return Error{name + ": " + data.error().message};
  if (data->id != id) return Error{name + ": the data is that of keyframe " + ToString(data->id)};
  return data;
}

}  // namespace portolan
