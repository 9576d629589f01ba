#include "atlas/map_saver.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <utility>
#include <vector>

#include "map/random_edits.h"

namespace portolan {
namespace {

namespace fs = std::filesystem;
constexpr double kIntervalS = 3;

class MapSaverTest : public ::testing::Test {
 protected:
  MapSaverTest() {
    std::string name = fs::temp_directory_path() / "portolan_saver_XXXXXX";
    folder_ = mkdtemp(name.data());
    auto store = MapStore::Open(folder_ / "atlas.db");
    PORTOLAN_CHECK(store.ok()) << store.error().message;
    store_ = std::move(*store);
  }
  ~MapSaverTest() override { fs::remove_all(folder_); }

  /// Adds keyframes to the map, and brings the replica up to date.
  void Grow(int keyframes) {
    for (int i = 0; i < keyframes; ++i) edits_.Edit(RandomEdits::kAddKeyFrame);
    edits_.Edit(RandomEdits::kAddPoint);
    MapReplica& replica = replicas_.try_emplace(map_.id(), map_.id()).first->second;
    for (const auto& [id, data] : edits_.data()) replica.AddKeyFrameData(data);
    replica.AddDelta(map_.TakeDelta());
    ASSERT_EQ(replica.ApplyPending().size(), 1u);
  }
  Revision StoredRevision() {
    auto content = store_->Load();
    return !content.ok() || content->maps.empty() ? 0 : content->maps[0].snapshot.revision;
  }
  void Step(MapSaver* saver, double now_s) {
    const Status done = saver->Step(replicas_, now_s);
    ASSERT_TRUE(done.ok()) << done.error().message;
  }

  fs::path folder_;
  std::unique_ptr<MapStore> store_;
  Map map_{MapId(0, 1, 1), 1};
  RandomEdits edits_{1, &map_};
  std::map<MapId, MapReplica> replicas_;
};

TEST_F(MapSaverTest, StoresKeyFramesInBoundedPiecesThenTheState) {
  MapSaver saver(store_.get(), kIntervalS);
  Grow(48);  // and the two of the beginning
  EXPECT_FALSE(saver.IsComplete(replicas_));
  for (const size_t stored : {20u, 40u, 50u}) {
    Step(&saver, 0);
    EXPECT_EQ(store_->num_keyframes(), stored);
    EXPECT_EQ(StoredRevision(), 0u);
  }
  Step(&saver, 0);
  EXPECT_EQ(StoredRevision(), 1u);
  EXPECT_TRUE(saver.IsComplete(replicas_));
}

TEST_F(MapSaverTest, StoresKeyFramesAtOnceAndTheStateAtIntervals) {
  MapSaver saver(store_.get(), kIntervalS);
  Grow(1);
  Step(&saver, 0);
  Step(&saver, 0);
  ASSERT_EQ(StoredRevision(), 1u);
  Grow(1);
  Step(&saver, 1);
  EXPECT_EQ(store_->num_keyframes(), map_.keyframes().size());
  Step(&saver, 2.9);
  EXPECT_EQ(StoredRevision(), 1u);
  Step(&saver, 3);
  EXPECT_EQ(StoredRevision(), 2u);
}

TEST_F(MapSaverTest, SaveAllWaitsForNoInterval) {
  MapSaver saver(store_.get(), kIntervalS);
  Grow(1);
  int pieces = 0;
  ASSERT_TRUE(saver.SaveAll(replicas_, 0.1, [&] { ++pieces; }).ok());
  EXPECT_EQ(pieces, 2);
  Grow(60);
  ASSERT_TRUE(saver.SaveAll(replicas_, 0.2, [&] { ++pieces; }).ok());
  EXPECT_EQ(pieces, 2 + 4);
  EXPECT_EQ(StoredRevision(), 2u);
  EXPECT_TRUE(saver.IsComplete(replicas_));
}

TEST_F(MapSaverTest, NamesEachKeyFrameOnceThatItStored) {
  MapSaver saver(store_.get(), kIntervalS);
  Grow(28);  // and the two of the beginning
  std::vector<std::pair<MapId, KeyFrameId>> stored;
  for (const size_t expected : {20u, 10u, 0u}) {
    Step(&saver, 0);
    const auto piece = saver.TakeStored();
    EXPECT_EQ(piece.size(), expected);
    stored.insert(stored.end(), piece.begin(), piece.end());
  }
  std::vector<std::pair<MapId, KeyFrameId>> all;
  for (const auto& [id, keyframe] : map_.keyframes()) all.emplace_back(map_.id(), id);
  EXPECT_EQ(stored, all);
}

TEST_F(MapSaverTest, GoesOnWhenWhatIsStoredIsNoLongerInMemory) {
  MapSaver saver(store_.get(), kIntervalS);
  for (int round = 0; round < 3; ++round) {
    Grow(5);
    ASSERT_TRUE(saver.SaveAll(replicas_, round, [] {}).ok());
    for (const auto& [map, keyframe] : saver.TakeStored()) replicas_.at(map).DropAppearance(keyframe);
  }
  for (const auto& [id, keyframe] : replicas_.at(map_.id()).map().keyframes()) {
    EXPECT_FALSE(keyframe.data->features.HasAppearance());
    EXPECT_EQ(store_->LoadKeyFrame(id).value().features.descriptors, edits_.data().at(id)->features.descriptors);
  }
}

TEST_F(MapSaverTest, WritesNothingThatIsStoredAlready) {
  MapSaver saver(store_.get(), kIntervalS);
  Grow(1);
  saver.Restore(map_.id(), map_.epoch(), map_.revision());
  EXPECT_TRUE(saver.IsComplete(replicas_));
  Step(&saver, 10);
  EXPECT_EQ(store_->num_keyframes(), 0u);
}

}  // namespace
}  // namespace portolan
