#include "atlas/map_store.h"

#include "atlas/map_store_test_folder.h"
#include "map/map_io.h"

namespace portolan {
namespace {

using ::testing::HasSubstr;

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

TEST_F(MapStoreTest, LoadsMapsOneByOne) {
  {
    const auto store = Open(path_);
    for (const uint64_t seed : {3, 1, 2}) ASSERT_TRUE(Save(store.get(), MakeMap(seed)).ok());
  }
  const auto store = Open(path_);
  const Result<MapStore::Content> rest = store->LoadWithoutMaps();
  ASSERT_TRUE(rest.ok());
  EXPECT_TRUE(rest->maps.empty());
  std::vector<uint64_t> hashes;
  std::vector<std::string> problems;
  const auto take = [&](const MapStore::StoredMap& map) { hashes.push_back(HashOf(map)); };
  EXPECT_TRUE(store->LoadEachMap(take, &problems).ok());
  EXPECT_TRUE(problems.empty());
  EXPECT_EQ(hashes, (std::vector<uint64_t>{HashMap(MakeMap(1)), HashMap(MakeMap(2)), HashMap(MakeMap(3))}));
  EXPECT_TRUE(store->HasMap(MapId(0, 1, 2)));
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

/// Changes a map at random. @return what changed.
MapDelta Change(Map* map, RandomEdits* edits) {
  for (int i = 0; i < 20; ++i) edits->Next();
  edits->Edit(RandomEdits::kAddPoint);
  return map->TakeDelta();
}

TEST_F(MapStoreTest, ChangesGoOnFromTheStateAndFromEachOther) {
  Map map(MapId(0, 1, 1), 1);
  RandomEdits edits(4, &map);
  MapDelta last;
  for (int round = 0; round < 10; ++round) {
    const auto store = Open(path_);
    if (round > 0) {
      EXPECT_EQ(HashOf(Load(store.get()).maps.at(0)), HashMap(map)) << "as it was left";
    }
    last = Change(&map, &edits);
    if (round % 4 == 0) {
      EXPECT_EQ(MessageOf(Save(store.get(), map)), "");
      EXPECT_EQ(store->SizesOf(map.id()).change_bytes, 0u);
    } else {
      ASSERT_TRUE(store->CanAppend(last));
      std::vector<MapDelta> changes = {last, Change(&map, &edits)};
      ASSERT_EQ(MessageOf(store->SaveKeyFrames(DataOf(edits))), "");
      EXPECT_EQ(MessageOf(store->SaveChanges(changes)), "");
      EXPECT_FALSE(store->CanAppend(last)) << "what is stored has gone on";
      EXPECT_GT(store->SizesOf(map.id()).change_bytes, 0u);
    }
    EXPECT_EQ(HashOf(store->LoadMap(map.id()).value()), HashMap(map));
    EXPECT_EQ(store->LoadState(map.id()).value().revision, map.revision());
  }
  EXPECT_FALSE(Open(path_)->CanAppend(last)) << "of a file that was not loaded nothing is known";
}

TEST_F(MapStoreTest, KeyFramesOfChangesGoWithTheMap) {
  Map map(MapId(0, 1, 1), 1);
  RandomEdits edits(4, &map);
  const auto store = Open(path_);
  static_cast<void>(map.TakeDelta());
  ASSERT_TRUE(Save(store.get(), map).ok());
  edits.Edit(RandomEdits::kAddKeyFrame);
  const MapDelta change = map.TakeDelta();
  ASSERT_TRUE(store->SaveKeyFrames(DataOf(map)).ok());
  ASSERT_TRUE(store->SaveChanges({change}).ok());
  EXPECT_EQ(store->num_keyframes(), map.keyframes().size());
  ASSERT_TRUE(store->DeleteMap(map.id()).ok());
  EXPECT_EQ(store->num_keyframes(), 0u);
  EXPECT_FALSE(store->CanAppend(change));
}

TEST_F(MapStoreTest, AFileOfSchema2TakesChanges) {
  Map map(MapId(0, 1, 1), 1);
  RandomEdits edits(4, &map);
  static_cast<void>(Change(&map, &edits));
  ASSERT_TRUE(Save(Open(path_).get(), map).ok());
  ASSERT_TRUE(SqlDatabase::Open(path_)->Execute("DROP TABLE change; PRAGMA user_version = 2").ok());
  const auto store = Open(path_);
  EXPECT_EQ(HashOf(Load(store.get()).maps.at(0)), HashMap(map));
  const MapDelta change = Change(&map, &edits);
  ASSERT_TRUE(store->SaveKeyFrames(DataOf(map)).ok());
  EXPECT_EQ(MessageOf(store->SaveChanges({change})), "");
  EXPECT_EQ(HashOf(store->LoadMap(map.id()).value()), HashMap(map));
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
    ASSERT_TRUE(database->Execute("PRAGMA user_version = 4").ok());
  }
  EXPECT_THAT(OpenError(path_), HasSubstr("newer Portolan (schema 4"));
}

/// What later schemas have and schema 1 had not, taken out again.
void MakeSchema1(const fs::path& path) {
  auto database = SqlDatabase::Open(path);
  ASSERT_TRUE(database.ok());
  ASSERT_TRUE(database
                  ->Execute("DROP TABLE graph_map; DROP TABLE link; DROP TABLE fused; DROP TABLE activity; DROP TABLE "
                            "change; PRAGMA user_version = 1")
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
  const auto state = store->LoadState(map.id());
  ASSERT_TRUE(state.ok());
  EXPECT_EQ(state->keyframes.size(), stored->keyframes.size());
  EXPECT_THAT(store->LoadState(MapId(0, 7, 7)).error().message, HasSubstr("0.000007.7: it is not in the store"));

  ASSERT_EQ(MessageOf(store->ExportMap(map.id(), folder_ / "one.pmap")), "");
  const auto file = ReadMapFile(folder_ / "one.pmap");
  ASSERT_TRUE(file.ok()) << file.error().message;
  ASSERT_EQ(file->size(), 1u);
  EXPECT_EQ(HashOf((*file)[0]), HashMap(map));
  EXPECT_THAT(MessageOf(store->ExportMap(MapId(0, 7, 7), folder_ / "none.pmap")), HasSubstr("is not in the store"));
  EXPECT_THAT(MessageOf(store->ExportMap(map.id(), folder_ / "no_folder" / "one.pmap")), HasSubstr("no_folder"));
}

}  // namespace
}  // namespace portolan
