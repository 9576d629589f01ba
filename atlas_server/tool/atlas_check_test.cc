#include "tool/atlas_check.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>

#include "atlas/map_store.h"
#include "atlas/sqlite.h"
#include "dataset/temp_folder.h"
#include "map/random_edits.h"

namespace portolan {
namespace {

using ::testing::HasSubstr;

class AtlasCheckTest : public ::testing::Test {
 protected:
  AtlasCheckTest() : map_(MapId(0, 1, 1), 2) {
    RandomEdits edits(5, &map_);
    for (int i = 0; i < 200; ++i) edits.Next();
    static_cast<void>(map_.TakeDelta());
  }

  /// Stores the map, as granted in this epoch.
  void Store(Epoch granted) const {
    auto store = MapStore::Open(path_).value();
    std::vector<std::shared_ptr<const KeyFrameData>> data;
    for (const auto& [id, keyframe] : map_.keyframes()) data.push_back(keyframe.data);
    ASSERT_TRUE(store->SaveOwnership({map_.id(), 0, granted, ProcessId(0, 5, 1)}));
    ASSERT_TRUE(store->SaveKeyFrames(data));
    ASSERT_TRUE(store->SaveMap(map_.Snapshot()));
  }

  Map map_;
  TempFolder folder_;
  const std::string path_ = folder_.Path("atlas.db");
};

TEST_F(AtlasCheckTest, ListsWhatIsInASoundAtlas) {
  Store(map_.epoch());
  const AtlasCheck check = CheckAtlas(path_).value();
  EXPECT_TRUE(check.is_sound) << check.report;
  ASSERT_EQ(check.report["maps"].size(), 1u);
  const nlohmann::json& map = check.report["maps"][0];
  EXPECT_EQ(map["id"], ToString(map_.id()));
  EXPECT_EQ(map["epoch"], map_.epoch());
  EXPECT_EQ(map["revision"], map_.revision());
  EXPECT_EQ(map["points"], map_.points().size());
  ASSERT_EQ(map["keyframes"].size(), map_.keyframes().size());
  EXPECT_EQ(map["keyframes"][0], ToString(map_.keyframes().begin()->first));
}

TEST_F(AtlasCheckTest, NamesAMapWhoseDataIsGone) {
  Store(map_.epoch());
  {
    auto database = SqlDatabase::Open(path_).value();  // as long as it is open nobody else may read
    ASSERT_TRUE(database.Execute("DELETE FROM keyframe"));
  }
  const auto check = CheckAtlas(path_);
  ASSERT_TRUE(check) << check.error().message;
  EXPECT_FALSE(check->is_sound);
  EXPECT_THAT(check->report["problems"].dump(), HasSubstr(ToString(map_.id())));
}

TEST_F(AtlasCheckTest, AMapAheadOfItsGrantIsUnsound) {
  Store(map_.epoch() - 1);
  const AtlasCheck check = CheckAtlas(path_).value();
  EXPECT_FALSE(check.is_sound);
  EXPECT_THAT(check.report["problems"].dump(), HasSubstr("was the last that was granted"));
}

TEST_F(AtlasCheckTest, AFileThatIsNotThereIsNotMade) {
  const auto check = CheckAtlas(path_);
  ASSERT_FALSE(check);
  EXPECT_THAT(check.error().message, HasSubstr("no such file"));
  EXPECT_FALSE(std::filesystem::exists(path_));
}

}  // namespace
}  // namespace portolan
