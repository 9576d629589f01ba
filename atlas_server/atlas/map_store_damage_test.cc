// Files that are damaged, cut short or can't be written.

#include <sys/resource.h>
#include <unistd.h>

#include <csignal>

#include "atlas/map_store_test_folder.h"

namespace portolan {
namespace {

using ::testing::HasSubstr;

using MapStoreDamageTest = MapStoreTest;

/// One bit anywhere in a blob.
TEST_F(MapStoreDamageTest, DamageOfABlobIsNoticedAndNamed) {
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

TEST_F(MapStoreDamageTest, ADamagedChangeLeavesTheMapAsItWasBefore) {
  Map map(MapId(0, 1, 1), 1);
  RandomEdits edits(4, &map);
  std::vector<MapDelta> changes;
  uint64_t hash_before = 0;
  {
    const auto store = Open(path_);
    static_cast<void>(map.TakeDelta());
    ASSERT_TRUE(Save(store.get(), map).ok());
    for (int i = 0; i < 4; ++i) {
      if (i == 2) hash_before = HashMap(map);
      edits.Edit(RandomEdits::kAddPoint);
      changes.push_back(map.TakeDelta());
    }
    ASSERT_TRUE(store->SaveChanges(changes).ok());
  }
  ASSERT_TRUE(SqlDatabase::Open(path_)->Execute("UPDATE change SET delta = x'00' WHERE revision = 4").ok());
  const auto store = Open(path_);
  const MapStore::Content content = Load(store.get());
  ASSERT_EQ(content.maps.size(), 1u);
  EXPECT_EQ(HashOf(content.maps[0]), hash_before);
  ASSERT_EQ(content.problems.size(), 1u);
  EXPECT_THAT(content.problems[0], HasSubstr("map 0.000001.1 is as of revision 3: the change to revision 4: "));
  EXPECT_FALSE(store->CanAppend(changes[2])) << "one that is damaged is in the way";
  EXPECT_EQ(MessageOf(Save(store.get(), map)), "");
  EXPECT_EQ(HashOf(store->LoadMap(map.id()).value()), HashMap(map));
}

TEST_F(MapStoreDamageTest, RefusesAFolderThatCantBeWritten) {
  if (geteuid() == 0) GTEST_SKIP() << "root may write everywhere";
  fs::permissions(folder_, fs::perms::owner_read | fs::perms::owner_exec);
  EXPECT_THAT(OpenError(path_), HasSubstr(path_.string()));
  fs::permissions(folder_, fs::perms::owner_all);
}

TEST_F(MapStoreDamageTest, ATruncatedFileIsAnErrorOrLacksWhatWasCutOff) {
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

TEST_F(MapStoreDamageTest, ADamagedMapIsLeftOutAndNamedAndTheOthersLoad) {
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
  EXPECT_TRUE(store->IsDamaged(damaged.id()));
  EXPECT_FALSE(store->IsDamaged(sound.id()));
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

TEST_F(MapStoreDamageTest, AFullDiskLosesNothingThatWasAcknowledged) {
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

TEST_F(MapStoreDamageTest, AFullDiskAtTheStartIsAnError) {
  const FileSizeLimit limit(1000);
  EXPECT_THAT(OpenError(path_), HasSubstr(path_.string()));
}

}  // namespace
}  // namespace portolan
