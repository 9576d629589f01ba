#include "atlas/map_import.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>

#include "dataset/temp_folder.h"
#include "map/random_edits.h"

namespace portolan {
namespace {

using ::testing::HasSubstr;

class MapImportTest : public ::testing::Test {
 protected:
  MapImportTest() : map_(MapId(0, 1, 1), 1) {
    RandomEdits edits(5, &map_);
    for (int i = 0; i < 100; ++i) edits.Next();
    static_cast<void>(map_.TakeDelta());
  }
  std::unique_ptr<MapStore> MakeStore(const std::string& path) const {
    auto store = MapStore::Open(path);
    EXPECT_TRUE(store.ok());
    std::vector<std::shared_ptr<const KeyFrameData>> data;
    for (const auto& [id, keyframe] : map_.keyframes()) data.push_back(keyframe.data);
    EXPECT_TRUE((*store)->SaveKeyFrames(data).ok() && (*store)->SaveMap(map_.Snapshot()).ok());
    MapStore::Graph graph;
    graph.maps = {map_.id()};
    EXPECT_TRUE((*store)->SaveGraph(graph).ok());
    return std::move(*store);
  }
  static std::string ErrorOf(const std::string& path) {
    const auto content = ReadMapsOf(path);
    return content.ok() ? "" : content.error().message;
  }

  TempFolder folder_;
  Map map_;
};

TEST_F(MapImportTest, ReadsAMapFile) {
  ASSERT_TRUE(WriteMapFile(folder_.Path("a.pmap"), {&map_}).ok());
  const auto content = ReadMapsOf(folder_.Path("a.pmap"));
  ASSERT_TRUE(content.ok()) << content.error().message;
  ASSERT_EQ(content->maps.size(), 1u);
  EXPECT_EQ(HashMap(*RestoreMap(content->maps[0], nullptr)), HashMap(map_));
}

TEST_F(MapImportTest, ReadsAStoreWithItsGraph) {
  MakeStore(folder_.Path("a.db")).reset();
  const auto content = ReadMapsOf(folder_.Path("a.db"));
  ASSERT_TRUE(content.ok()) << content.error().message;
  ASSERT_EQ(content->maps.size(), 1u);
  EXPECT_EQ(HashMap(*RestoreMap(content->maps[0], nullptr)), HashMap(map_));
  EXPECT_EQ(content->graph.maps.size(), 1u);
}

TEST_F(MapImportTest, TellsWhatIsWrong) {
  EXPECT_THAT(ErrorOf(folder_.Path("none")), HasSubstr("can't be read"));
  EXPECT_FALSE(std::filesystem::exists(folder_.Path("none"))) << "a file was made";
  EXPECT_THAT(ErrorOf(folder_.Write("text", "something else")), HasSubstr("no map file"));
  EXPECT_THAT(ErrorOf(folder_.path()), HasSubstr("can't be read"));
  ASSERT_TRUE(MapStore::Open(folder_.Path("empty.db")).ok());
  EXPECT_THAT(ErrorOf(folder_.Path("empty.db")), HasSubstr("holds no map"));
  {
    auto foreign = SqlDatabase::Open(folder_.Path("foreign.db"));
    ASSERT_TRUE(foreign->Execute("CREATE TABLE a(b)").ok());
  }
  EXPECT_THAT(ErrorOf(folder_.Path("foreign.db")), HasSubstr("another program"));
}

TEST_F(MapImportTest, AStoreInUseIsAnError) {
  const auto store = MakeStore(folder_.Path("a.db"));
  EXPECT_THAT(ErrorOf(folder_.Path("a.db")), HasSubstr("locked"));
}

TEST_F(MapImportTest, AStoreOfDamagedMapsAloneIsAnErrorThatNamesOne) {
  MakeStore(folder_.Path("a.db")).reset();
  {
    auto database = SqlDatabase::Open(folder_.Path("a.db"));
    ASSERT_TRUE(database->Execute("UPDATE map SET state = zeroblob(10)").ok());
  }
  EXPECT_THAT(ErrorOf(folder_.Path("a.db")), HasSubstr("map 0.000001.1 is left out"));
}

}  // namespace
}  // namespace portolan
