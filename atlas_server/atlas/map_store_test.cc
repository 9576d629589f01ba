#include "atlas/map_store.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <unistd.h>

#include <csignal>
#include <filesystem>
#include <fstream>

#include "base/random.h"
#include "map/map_io.h"
#include "map/random_edits.h"

namespace portolan {
namespace {

using ::testing::HasSubstr;
namespace fs = std::filesystem;

std::string MessageOf(const Status& status) {
  return status.ok() ? "" : status.error().message;
}

class MapStoreTest : public ::testing::Test {
 protected:
  MapStoreTest() {
    std::string name = fs::temp_directory_path() / "portolan_store_XXXXXX";
    folder_ = mkdtemp(name.data());
    path_ = folder_ / "atlas.db";
  }
  ~MapStoreTest() override { fs::remove_all(folder_); }

  static std::unique_ptr<MapStore> Open(const fs::path& path) {
    auto store = MapStore::Open(path);
    EXPECT_TRUE(store.ok()) << (store.ok() ? "" : store.error().message);
    return store.ok() ? std::move(*store) : nullptr;
  }
  static std::string OpenError(const fs::path& path) {
    const auto store = MapStore::Open(path);
    return store.ok() ? "" : store.error().message;
  }

  static std::vector<std::shared_ptr<const KeyFrameData>> DataOf(const Map& map) {
    std::vector<std::shared_ptr<const KeyFrameData>> data;
    for (const auto& [id, keyframe] : map.keyframes()) data.push_back(keyframe.data);
    return data;
  }
  static Status Save(MapStore* store, const Map& map) {
    Status saved = store->SaveKeyFrames(DataOf(map));
    return saved ? store->SaveMap(map.Snapshot()) : saved;
  }

  /// The map that a store holds, rebuilt.
  static uint64_t HashOf(const MapStore::StoredMap& stored) {
    std::map<KeyFrameId, std::shared_ptr<const KeyFrameData>> data;
    for (const KeyFrameData& keyframe : stored.keyframes) data[keyframe.id] = MakeKeyFrameData(keyframe, nullptr);
    Map map(stored.snapshot.map);
    const Status applied = map.Apply(stored.snapshot, [&](KeyFrameId id) { return data.at(id); });
    EXPECT_TRUE(applied.ok()) << MessageOf(applied);
    return HashMap(map);
  }
  static MapStore::Content Load(MapStore* store) {
    Result<MapStore::Content> content = store->Load();
    EXPECT_TRUE(content.ok()) << (content.ok() ? "" : content.error().message);
    return content.ok() ? std::move(*content) : MapStore::Content();
  }

  Map MakeMap(uint64_t seed, int edits = 100) {
    Map map(MapId(0, 1, static_cast<uint32_t>(seed)), seed);
    RandomEdits editor(seed, &map);
    for (int i = 0; i < edits; ++i) editor.Next();
    static_cast<void>(map.TakeDelta());
    return map;
  }

  fs::path folder_, path_;
};

TEST_F(MapStoreTest, WhatWasSavedIsThereAfterwards) {
  const Map map = MakeMap(3);
  {
    const auto store = Open(path_);
    EXPECT_TRUE(Load(store.get()).maps.empty());
    EXPECT_EQ(MessageOf(Save(store.get(), map)), "");
    EXPECT_EQ(MessageOf(store->SaveOwnership({map.id(), 40000, 5, ProcessId(40000, 2, 1)})), "");
    EXPECT_EQ(store->num_keyframes(), map.keyframes().size());
  }
  const auto store = Open(path_);
  EXPECT_EQ(store->num_keyframes(), map.keyframes().size());
  const MapStore::Content content = Load(store.get());
  ASSERT_EQ(content.maps.size(), 1u);
  EXPECT_EQ(HashOf(content.maps[0]), HashMap(map));
  EXPECT_EQ(content.maps[0].snapshot.revision, map.revision());
  EXPECT_EQ(content.maps[0].snapshot.epoch, map.epoch());
  ASSERT_EQ(content.ownerships.size(), 1u);
  EXPECT_EQ(content.ownerships[0].map, map.id());
  EXPECT_EQ(content.ownerships[0].robot, 40000);
  EXPECT_EQ(content.ownerships[0].epoch, 5u);
  EXPECT_EQ(content.ownerships[0].owner, ProcessId(40000, 2, 1));
  EXPECT_TRUE(content.problems.empty());
}

TEST_F(MapStoreTest, LoadsOneKeyFrame) {
  const Map map = MakeMap(3);
  const auto store = Open(path_);
  ASSERT_TRUE(Save(store.get(), map).ok());
  for (const auto& [id, keyframe] : map.keyframes()) {
    const Result<KeyFrameData> data = store->LoadKeyFrame(id);
    ASSERT_TRUE(data.ok()) << data.error().message;
    EXPECT_EQ(EncodeKeyFrameData(*data), EncodeKeyFrameData(*keyframe.data));
  }
  const Result<KeyFrameData> unknown = store->LoadKeyFrame(KeyFrameId(0, 1, 0xfffff0));
  ASSERT_FALSE(unknown.ok());
  EXPECT_THAT(unknown.error().message, HasSubstr(path_.string()));
  EXPECT_THAT(unknown.error().message, HasSubstr("not in the store"));
}

TEST_F(MapStoreTest, RefusesDataThatIsNotWhole) {
  const Map map = MakeMap(3);
  const auto store = Open(path_);
  const Status saved = store->SaveKeyFrames({WithoutAppearance(*map.keyframes().begin()->second.data)});
  EXPECT_THAT(MessageOf(saved), HasSubstr("no descriptors"));
  EXPECT_EQ(store->num_keyframes(), 0u);
}

TEST_F(MapStoreTest, ALaterStateReplacesTheOneBeforeAndDropsWhatLeftTheMap) {
  Map map(MapId(0, 1, 1), 1);
  RandomEdits edits(4, &map);
  const auto store = Open(path_);
  for (int round = 0; round < 10; ++round) {
    for (int i = 0; i < 50; ++i) edits.Next();
    static_cast<void>(map.TakeDelta());
    ASSERT_EQ(MessageOf(Save(store.get(), map)), "");
    EXPECT_EQ(store->num_keyframes(), map.keyframes().size());
  }
  EXPECT_GT(edits.data().size(), map.keyframes().size()) << "the example removes keyframes";
  const MapStore::Content content = Load(store.get());
  ASSERT_EQ(content.maps.size(), 1u);
  EXPECT_EQ(HashOf(content.maps[0]), HashMap(map));
}

/// As after a fusion: a keyframe may pass from one map to another.
TEST_F(MapStoreTest, AKeyFrameOfTwoMapsStaysWhileOneHasIt) {
  const Map map = MakeMap(3);
  const auto store = Open(path_);
  ASSERT_TRUE(Save(store.get(), map).ok());
  MapDelta other = map.Snapshot();
  other.map = MapId(0, 1, 99);
  ASSERT_TRUE(store->SaveMap(other).ok());
  MapDelta emptied;
  emptied.map = map.id();
  emptied.revision = map.revision() + 1;
  ASSERT_TRUE(store->SaveMap(emptied).ok());
  EXPECT_EQ(store->num_keyframes(), map.keyframes().size());
  EXPECT_EQ(Load(store.get()).maps.size(), 2u);
}

/// The files as a crash leaves them: copied while the store is open.
TEST_F(MapStoreTest, WhatWasAcknowledgedSurvivesACrash) {
  const auto store = Open(path_);
  for (uint64_t seed = 1; seed <= 3; ++seed) {
    const Map map = MakeMap(seed);
    ASSERT_TRUE(Save(store.get(), map).ok());
    ASSERT_TRUE(store->SaveOwnership({map.id(), 0, seed, ProcessId(0, 1, 1)}).ok());
    const fs::path copy = folder_ / std::to_string(seed);
    fs::create_directory(copy);
    for (const char* name : {"atlas.db", "atlas.db-wal"}) fs::copy_file(folder_ / name, copy / name);
    const auto survivor = Open(copy / "atlas.db");
    const MapStore::Content content = Load(survivor.get());
    ASSERT_EQ(content.maps.size(), seed);
    EXPECT_EQ(HashOf(content.maps.back()), HashMap(map));
    EXPECT_EQ(content.ownerships.size(), seed);
  }
}

TEST_F(MapStoreTest, IsOpenOnce) {
  const auto store = Open(path_);
  const std::string message = OpenError(path_);
  EXPECT_THAT(message, HasSubstr(path_.string()));
  EXPECT_THAT(message, HasSubstr("locked"));
}

TEST_F(MapStoreTest, RefusesFilesOfOtherKindsAndLeavesThemAsTheyAre) {
  const std::string garbage(5000, 'x');
  std::ofstream(path_) << garbage;
  EXPECT_THAT(OpenError(path_), HasSubstr(path_.string()));
  EXPECT_THAT(OpenError(path_), HasSubstr("not a database"));
  EXPECT_EQ(fs::file_size(path_), garbage.size());

  const fs::path foreign = folder_ / "foreign.db";
  {
    auto database = SqlDatabase::Open(foreign);
    ASSERT_TRUE(database.ok());
    ASSERT_TRUE(database->Execute("CREATE TABLE keyframe(name TEXT)").ok());
  }
  EXPECT_THAT(OpenError(foreign), HasSubstr("another program"));
  EXPECT_THAT(OpenError(folder_), HasSubstr(folder_.string()));
  EXPECT_THAT(OpenError(folder_ / "no_such_folder" / "atlas.db"), HasSubstr("no_such_folder"));
}

TEST_F(MapStoreTest, RefusesANewerSchema) {
  Open(path_).reset();
  {
    auto database = SqlDatabase::Open(path_);
    ASSERT_TRUE(database->Execute("PRAGMA user_version = 3").ok());
  }
  EXPECT_THAT(OpenError(path_), HasSubstr("newer Portolan (schema 3"));
}

/// What schema 2 has and schema 1 had not, taken out again.
void MakeSchema1(const fs::path& path) {
  auto database = SqlDatabase::Open(path);
  ASSERT_TRUE(database.ok());
  ASSERT_TRUE(
      database
          ->Execute(
              "DROP TABLE graph_map; DROP TABLE link; DROP TABLE fused; DROP TABLE activity; PRAGMA user_version = 1")
          .ok());
}

TEST_F(MapStoreTest, AFileOfSchema1KeepsItsMapsAndGetsAGraph) {
  const Map map = MakeMap(3);
  ASSERT_TRUE(Save(Open(path_).get(), map).ok());
  MakeSchema1(path_);
  MapStore::Graph graph;
  graph.links = {{MapId(0, 1, 1), MapId(0, 1, 2), Sim3d(), {}}};
  {
    const auto store = Open(path_);
    const MapStore::Content content = Load(store.get());
    ASSERT_EQ(content.maps.size(), 1u);
    EXPECT_EQ(HashOf(content.maps[0]), HashMap(map));
    EXPECT_TRUE(content.graph.links.empty() && content.graph.activities.empty());
    EXPECT_EQ(MessageOf(store->SaveGraph(graph)), "");
  }
  EXPECT_EQ(Load(Open(path_).get()).graph.links.size(), 1u);
}

TEST_F(MapStoreTest, AMigrationThatFailsLeavesTheFileAsItWas) {
  ASSERT_TRUE(Save(Open(path_).get(), MakeMap(3)).ok());
  MakeSchema1(path_);
  {  // a table in the way of the second of the new ones
    auto database = SqlDatabase::Open(path_);
    ASSERT_TRUE(database->Execute("CREATE TABLE activity(x)").ok());
  }
  EXPECT_THAT(OpenError(path_), HasSubstr("activity"));
  auto database = SqlDatabase::Open(path_);
  EXPECT_EQ(*database->QueryInteger("PRAGMA user_version"), 1u);
  EXPECT_EQ(*database->QueryInteger("SELECT count(*) FROM sqlite_schema WHERE name = 'link'"), 0u);
  EXPECT_EQ(*database->QueryInteger("SELECT count(*) FROM map"), 1u);
}

MapStore::Graph MakeGraph() {
  const MapId a(0, 1, 1), b(0, 1, 2), c(3, 1, 1);
  const Sim3d first(0.5, Eigen::Quaterniond(Eigen::AngleAxisd(0.3, Eigen::Vector3d::UnitY())), {1, 2, 3});
  MapStore::Graph graph;
  graph.maps = {a, b, c};
  graph.links = {{a, b, first, {}}, {a, c, first.Inverse(), {}}};
  graph.links[1].origin = MapGraph::Origin::kEntered;
  graph.activities = {{a, b, 3}, {b, c, 1}};
  graph.fused = {{a, MapId(40000, 1, 7), first}};
  return graph;
}

template <class T>
void ExpectSameTransform(const T& a, const T& b) {
  EXPECT_EQ(a.map, b.map);
  EXPECT_EQ(a.other, b.other);
  EXPECT_EQ(a.map_from_other.scale, b.map_from_other.scale);
  EXPECT_EQ(a.map_from_other.rotation.coeffs(), b.map_from_other.rotation.coeffs());
  EXPECT_EQ(a.map_from_other.translation, b.map_from_other.translation);
}

TEST_F(MapStoreTest, KeepsTheMapGraph) {
  const MapStore::Graph graph = MakeGraph();
  {
    const auto store = Open(path_);
    const MapId other(0, 1, 8), another(0, 1, 9);
    MapStore::Graph before;
    before.maps = {other, another};
    before.links = {{other, another, Sim3d(), {}}};
    before.activities = {{other, another, 7}};
    before.fused = {{other, another, Sim3d()}};
    ASSERT_EQ(MessageOf(store->SaveGraph(before)), "");
    ASSERT_EQ(MessageOf(store->SaveGraph(graph)), "") << "in place of the one before";
  }
  const MapStore::Graph loaded = Load(Open(path_).get()).graph;
  EXPECT_EQ(loaded.maps, graph.maps);
  ASSERT_EQ(loaded.links.size(), graph.links.size());
  for (size_t i = 0; i < graph.links.size(); ++i) {
    ExpectSameTransform(loaded.links[i], graph.links[i]);
    EXPECT_EQ(loaded.links[i].origin, graph.links[i].origin);
  }
  ASSERT_EQ(loaded.fused.size(), 1u);
  ExpectSameTransform(loaded.fused[0], graph.fused[0]);
  ASSERT_EQ(loaded.activities.size(), graph.activities.size());
  for (size_t i = 0; i < graph.activities.size(); ++i) {
    EXPECT_EQ(loaded.activities[i].map, graph.activities[i].map);
    EXPECT_EQ(loaded.activities[i].other, graph.activities[i].other);
    EXPECT_EQ(loaded.activities[i].count, graph.activities[i].count);
  }
}

TEST_F(MapStoreTest, ADeletedMapIsGoneWithWhatIsItsAlone) {
  const Map map = MakeMap(3);
  MapDelta other = map.Snapshot();  // with keyframes in common, as after a fusion
  other.map = MapId(0, 1, 2);
  {
    const auto store = Open(path_);
    ASSERT_TRUE(Save(store.get(), map).ok());
    ASSERT_TRUE(store->SaveMap(other).ok());
    ASSERT_TRUE(store->SaveOwnership({map.id(), 0, 1, ProcessId(0, 1, 1)}).ok());
    ASSERT_TRUE(store->SaveOwnership({other.map, 0, 1, ProcessId(0, 1, 1)}).ok());
    MapStore::Graph graph;
    graph.maps = {map.id(), other.map};
    graph.links = {{map.id(), other.map, Sim3d(), {}}};
    graph.activities = {{other.map, MapId(0, 1, 9), 1}};
    graph.fused = {{other.map, map.id(), Sim3d()}};
    ASSERT_TRUE(store->SaveGraph(graph).ok());
    ASSERT_EQ(MessageOf(store->DeleteMap(map.id())), "");
    EXPECT_FALSE(store->HasMap(map.id()));
    EXPECT_EQ(store->num_keyframes(), map.keyframes().size());
    EXPECT_EQ(MessageOf(store->DeleteMap(MapId(0, 7, 7))), "") << "one that is not there";
  }
  const auto store = Open(path_);
  MapStore::Content content = Load(store.get());
  ASSERT_EQ(content.maps.size(), 1u);
  EXPECT_EQ(content.maps[0].snapshot.map, other.map);
  ASSERT_EQ(content.ownerships.size(), 1u);
  EXPECT_TRUE(content.graph.links.empty());
  EXPECT_EQ(content.graph.maps.size(), 1u);
  EXPECT_EQ(content.graph.activities.size(), 1u);
  EXPECT_EQ(content.graph.fused.size(), 1u) << "that it went into the other is still known";
  ASSERT_EQ(MessageOf(store->DeleteMap(other.map)), "");
  EXPECT_EQ(store->num_keyframes(), 0u);
  content = Load(store.get());
  EXPECT_TRUE(content.maps.empty() && content.ownerships.empty() && content.graph.activities.empty());
}

TEST_F(MapStoreTest, LoadsOneMapAndExportsIt) {
  const Map map = MakeMap(3);
  const auto store = Open(path_);
  ASSERT_TRUE(Save(store.get(), map).ok());
  const auto stored = store->LoadMap(map.id());
  ASSERT_TRUE(stored.ok()) << stored.error().message;
  EXPECT_EQ(HashOf(*stored), HashMap(map));
  EXPECT_THAT(store->LoadMap(MapId(0, 7, 7)).error().message, HasSubstr("is not in the store"));

  ASSERT_EQ(MessageOf(store->ExportMap(map.id(), folder_ / "one.pmap")), "");
  const auto file = ReadMapFile(folder_ / "one.pmap");
  ASSERT_TRUE(file.ok()) << file.error().message;
  ASSERT_EQ(file->size(), 1u);
  EXPECT_EQ(HashOf((*file)[0]), HashMap(map));
  EXPECT_THAT(MessageOf(store->ExportMap(MapId(0, 7, 7), folder_ / "none.pmap")), HasSubstr("is not in the store"));
  EXPECT_THAT(MessageOf(store->ExportMap(map.id(), folder_ / "no_folder" / "one.pmap")), HasSubstr("no_folder"));
}

/// One bit anywhere in a blob.
TEST_F(MapStoreTest, DamageOfABlobIsNoticedAndNamed) {
  const Map map = MakeMap(3);
  {
    const auto store = Open(path_);
    ASSERT_TRUE(Save(store.get(), map).ok());
    MapStore::Graph graph;
    graph.links = {{MapId(0, 1, 5), MapId(0, 1, 6), Sim3d(), {}}};
    graph.fused = {{MapId(0, 1, 7), MapId(0, 1, 8), Sim3d()}};
    ASSERT_TRUE(store->SaveGraph(graph).ok());
  }
  Random random(1);
  const struct {
    const char* table;
    const char* column;
    const char* named;
  } blobs[] = {{"keyframe", "data", "keyframe 0."},
               {"map", "state", "map state"},
               {"link", "transform", "link of map 0.000001.5 and map 0.000001.6"},
               {"fused", "transform", "fusion of map 0.000001.7 and map 0.000001.8"}};
  for (const auto& [table, column, named] : blobs) {
    for (int round = 0; round < 20; ++round) {
      const fs::path copy = folder_ / "copy.db";
      fs::copy_file(path_, copy, fs::copy_options::overwrite_existing);
      {
        auto database = SqlDatabase::Open(copy);
        const std::string where = " FROM " + std::string(table) + " LIMIT 1";
        const uint64_t row = *database->QueryInteger("SELECT rowid" + where);
        std::string blob;
        {
          auto query = database->Prepare("SELECT " + std::string(column) + where);
          ASSERT_TRUE(*query->Step());
          blob = query->Blob(0);
        }
        const size_t at = random.Below(blob.size());
        blob[at] = static_cast<char>(blob[at] ^ 1 << random.Below(8));
        auto update = database->Prepare("UPDATE " + std::string(table) + " SET " + column + " = ?1 WHERE rowid = ?2");
        ASSERT_TRUE(update->Bind(1, std::string_view(blob)).Bind(2, row).Step().ok());
      }
      const MapStore::Content content = Load(Open(copy).get());
      ASSERT_EQ(content.problems.size(), 1u) << table << ", round " << round;
      EXPECT_THAT(content.problems[0], HasSubstr(named));
    }
  }
}

TEST_F(MapStoreTest, RefusesAFolderThatCantBeWritten) {
  if (geteuid() == 0) GTEST_SKIP() << "root may write everywhere";
  fs::permissions(folder_, fs::perms::owner_read | fs::perms::owner_exec);
  EXPECT_THAT(OpenError(path_), HasSubstr(path_.string()));
  fs::permissions(folder_, fs::perms::owner_all);
}

TEST_F(MapStoreTest, ATruncatedFileIsAnErrorOrLacksWhatWasCutOff) {
  const Map map = MakeMap(3, 400);
  {
    const auto store = Open(path_);
    ASSERT_TRUE(Save(store.get(), map).ok());
  }
  const auto size = fs::file_size(path_);
  ASSERT_GE(size, 8u * 4096);
  for (const auto left : {size / 2, size - 4096, size / 10, uintmax_t{4096}, uintmax_t{100}}) {
    const fs::path cut = folder_ / ("cut_" + std::to_string(left));
    fs::copy_file(path_, cut);
    fs::resize_file(cut, left);
    auto store = MapStore::Open(cut);
    if (!store.ok()) {
      EXPECT_THAT(store.error().message, HasSubstr(cut.string()));
      continue;
    }
    const Result<MapStore::Content> content = (*store)->Load();
    if (!content.ok()) {
      EXPECT_THAT(content.error().message, HasSubstr(cut.string()));
      continue;
    }
    EXPECT_TRUE(content->maps.empty()) << left;
    EXPECT_FALSE(content->problems.empty()) << left;
  }
}

TEST_F(MapStoreTest, ADamagedMapIsLeftOutAndNamedAndTheOthersLoad) {
  const Map sound = MakeMap(3), damaged = MakeMap(4);
  {
    const auto store = Open(path_);
    ASSERT_TRUE(Save(store.get(), sound).ok());
    const auto data = DataOf(damaged);
    std::vector<std::shared_ptr<const KeyFrameData>> renamed;  // both examples number their keyframes alike
    MapDelta snapshot = damaged.Snapshot();
    for (auto& state : snapshot.keyframes) state.id.value += 1000;
    for (auto& state : snapshot.keyframes) {
      if (state.parent.IsValid()) state.parent.value += 1000;
    }
    for (auto& state : snapshot.observations) state.keyframe.value += 1000;
    for (const auto& one : data) {
      KeyFrameData copy = *one;
      copy.id.value += 1000;
      renamed.push_back(MakeKeyFrameData(std::move(copy), nullptr));
    }
    ASSERT_TRUE(store->SaveKeyFrames(renamed).ok());
    ASSERT_TRUE(store->SaveMap(snapshot).ok());
  }
  {
    auto database = SqlDatabase::Open(path_);
    const std::string id = std::to_string(damaged.keyframes().begin()->first.value + 1000);
    ASSERT_TRUE(database->Execute("UPDATE keyframe SET data = zeroblob(100) WHERE id = " + id).ok());
  }
  const auto store = Open(path_);
  const MapStore::Content content = Load(store.get());
  ASSERT_EQ(content.maps.size(), 1u);
  EXPECT_EQ(HashOf(content.maps[0]), HashMap(sound));
  ASSERT_EQ(content.problems.size(), 1u);
  EXPECT_THAT(content.problems[0], HasSubstr(ToString(damaged.id())));
  EXPECT_THAT(content.problems[0], HasSubstr(path_.string()));
}

/// A limit on the size of files is what a test can have without a file system of its own: writes beyond it fail as on a
/// full disk.
class FileSizeLimit {
 public:
  explicit FileSizeLimit(rlim_t bytes) {
    std::signal(SIGXFSZ, SIG_IGN);
    getrlimit(RLIMIT_FSIZE, &before_);
    rlimit limit = before_;
    limit.rlim_cur = bytes;
    setrlimit(RLIMIT_FSIZE, &limit);
  }
  ~FileSizeLimit() { setrlimit(RLIMIT_FSIZE, &before_); }

 private:
  rlimit before_{};
};

TEST_F(MapStoreTest, AFullDiskLosesNothingThatWasAcknowledged) {
  Map map(MapId(0, 1, 1), 1);
  RandomEdits edits(4, &map);
  const auto store = Open(path_);
  Map stored = map;
  bool failed = false;
  {
    const FileSizeLimit limit(300'000);
    for (int round = 0; round < 200 && !failed; ++round) {
      for (int i = 0; i < 20; ++i) edits.Next();
      static_cast<void>(map.TakeDelta());
      const Status saved = Save(store.get(), map);
      failed = !saved.ok();
      if (!failed) {
        stored = map;
        continue;
      }
      EXPECT_THAT(MessageOf(saved), HasSubstr(path_.string()));
    }
    EXPECT_TRUE(failed);
    EXPECT_FALSE(Save(store.get(), map).ok()) << "still full";
    const MapStore::Content content = Load(store.get());
    ASSERT_EQ(content.maps.size(), 1u);
    EXPECT_EQ(HashOf(content.maps[0]), HashMap(stored));
  }
  EXPECT_EQ(MessageOf(Save(store.get(), map)), "") << "room again";
  EXPECT_EQ(HashOf(Load(store.get()).maps.at(0)), HashMap(map));
}

TEST_F(MapStoreTest, AFullDiskAtTheStartIsAnError) {
  const FileSizeLimit limit(1000);
  EXPECT_THAT(OpenError(path_), HasSubstr(path_.string()));
}

}  // namespace
}  // namespace portolan
