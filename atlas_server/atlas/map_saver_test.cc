#include "atlas/map_saver.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <map>
#include <memory>
#include <utility>
#include <vector>

#include "map/random_edits.h"

namespace portolan {
namespace {

namespace fs = std::filesystem;
constexpr double kIntervalS = 0.2;

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
  void Grow(MapSaver* saver, int keyframes) {
    for (int i = 0; i < keyframes; ++i) edits_.Edit(RandomEdits::kAddKeyFrame);
    edits_.Edit(RandomEdits::kAddPoint);
    Follow(saver, map_.TakeDelta());
  }
  void Follow(MapSaver* saver, const MapDelta& delta) { Follow(saver, edits_, delta); }
  void Follow(MapSaver* saver, const RandomEdits& edits, const MapDelta& delta) {
    MapReplica& replica = replicas_.try_emplace(delta.map, delta.map).first->second;
    for (const auto& [id, data] : edits.data()) replica.AddKeyFrameData(data);
    replica.AddDelta(delta);
    const std::vector<MapDelta> applied = replica.ApplyPending();
    ASSERT_EQ(applied.size(), 1u);
    saver->OnApplied(applied[0]);
  }
  /// As a new owner would publish it.
  void Begin(MapSaver* saver, Epoch epoch) {
    MapDelta snapshot = map_.Snapshot();
    snapshot.epoch = epoch;
    Follow(saver, snapshot);
  }
  Revision StoredRevision() {
    auto content = store_->Load();
    return !content.ok() || content->maps.empty() ? 0 : content->maps[0].snapshot.revision;
  }
  size_t ChangeBytes() const { return store_->SizesOf(map_.id()).change_bytes; }
  /// @return whether something was written.
  bool Step(MapSaver* saver, double now_s) {
    const Result<bool> done = saver->Step(replicas_, now_s);
    EXPECT_TRUE(done.ok()) << done.error().message;
    return done.ok() && *done;
  }

  fs::path folder_;
  std::unique_ptr<MapStore> store_;
  Map map_{MapId(0, 1, 1), 1};
  RandomEdits edits_{1, &map_};
  std::map<MapId, MapReplica> replicas_;
};

TEST_F(MapSaverTest, StoresKeyFramesInBoundedPiecesThenTheState) {
  MapSaver saver(store_.get(), kIntervalS);
  Grow(&saver, 48);  // and the two of the beginning
  EXPECT_FALSE(saver.IsComplete(replicas_));
  for (const size_t stored : {20u, 40u}) {
    EXPECT_TRUE(Step(&saver, 0));
    EXPECT_EQ(store_->num_keyframes(), stored);
    EXPECT_EQ(StoredRevision(), 0u);
  }
  EXPECT_TRUE(Step(&saver, 0));
  EXPECT_EQ(store_->num_keyframes(), 50u);
  EXPECT_EQ(StoredRevision(), 1u);
  EXPECT_TRUE(saver.IsComplete(replicas_));
  EXPECT_FALSE(Step(&saver, 10));
}

TEST_F(MapSaverTest, StoresKeyFramesAtOnceAndChangesAtIntervals) {
  MapSaver saver(store_.get(), kIntervalS);
  Grow(&saver, 1);
  while (Step(&saver, 0)) continue;
  ASSERT_EQ(StoredRevision(), 1u);
  Grow(&saver, 1);
  Grow(&saver, 1);
  EXPECT_TRUE(Step(&saver, 0.01));
  EXPECT_EQ(store_->num_keyframes(), map_.keyframes().size());
  EXPECT_EQ(StoredRevision(), 3u) << "both changes";
  EXPECT_GT(ChangeBytes(), 0u);
  Grow(&saver, 1);
  EXPECT_TRUE(Step(&saver, 0.2));
  EXPECT_EQ(store_->num_keyframes(), map_.keyframes().size());
  EXPECT_EQ(StoredRevision(), 3u);
  EXPECT_FALSE(saver.IsComplete(replicas_));
  EXPECT_FALSE(Step(&saver, 0.2));
  EXPECT_TRUE(Step(&saver, 0.22));
  EXPECT_EQ(StoredRevision(), 4u);
  EXPECT_TRUE(saver.IsComplete(replicas_));
}

TEST_F(MapSaverTest, ChangesAreStoredThoughEachStepFindsANewKeyFrame) {
  MapSaver saver(store_.get(), kIntervalS);
  for (int step = 0; step < 20; ++step) {
    Grow(&saver, 1);
    EXPECT_TRUE(Step(&saver, step));
    EXPECT_TRUE(saver.IsComplete(replicas_)) << "step " << step;
  }
}

/// Robots with a map each, which all have something new at each step.
TEST_F(MapSaverTest, MapsHaveTheirTurnsThoughEachGrowsAllTheTime) {
  constexpr uint32_t kMaps = 4;
  MapSaver saver(store_.get(), kIntervalS);
  std::vector<std::unique_ptr<Map>> maps;
  std::vector<std::unique_ptr<RandomEdits>> edits;
  for (uint32_t robot = 0; robot < kMaps; ++robot) {
    maps.push_back(std::make_unique<Map>(MapId(static_cast<RobotId>(robot), 1, 1), 1));
    edits.push_back(std::make_unique<RandomEdits>(robot, maps.back().get(), robot + 1));
  }
  std::map<MapId, int> pieces;
  for (int step = 0; step < 40; ++step) {
    for (uint32_t robot = 0; robot < kMaps; ++robot) {
      edits[robot]->Edit(RandomEdits::kAddKeyFrame);
      Follow(&saver, *edits[robot], maps[robot]->TakeDelta());
    }
    ASSERT_TRUE(Step(&saver, step));
    for (const auto& [id, replica] : replicas_) pieces[id] += saver.IsSaved(replica.map());
  }
  for (const auto& [id, written] : pieces) EXPECT_EQ(written, 10) << "map " << id;
}

TEST_F(MapSaverTest, AMapThatRestsIsOneState) {
  MapSaver saver(store_.get(), kIntervalS);
  Grow(&saver, 1);
  while (Step(&saver, 0)) continue;
  Grow(&saver, 0);
  ASSERT_TRUE(Step(&saver, 1));
  const size_t change_bytes = ChangeBytes();
  ASSERT_GT(change_bytes, 0u);
  EXPECT_FALSE(Step(&saver, 1 + MapSaver::kRestS - 0.1));
  EXPECT_EQ(ChangeBytes(), change_bytes);
  EXPECT_TRUE(Step(&saver, 1 + MapSaver::kRestS));
  EXPECT_EQ(ChangeBytes(), 0u);
  EXPECT_EQ(StoredRevision(), 2u);
}

TEST_F(MapSaverTest, ChangesNeverBecomeMuchBesideTheState) {
  MapSaver saver(store_.get(), kIntervalS);
  double now_s = 0;
  size_t most = 0, states = 0;
  for (int round = 0; round < 1500; ++round) {
    for (int i = 0; i < 40; ++i) edits_.Edit(RandomEdits::kAddPoint);
    Grow(&saver, 0);
    for (now_s += 2 * kIntervalS; Step(&saver, now_s);) {
      most = std::max(most, ChangeBytes());
      states += ChangeBytes() == 0;
    }
    ASSERT_TRUE(saver.IsComplete(replicas_) || ChangeBytes() == 0);
  }
  EXPECT_GT(most, MapSaver::kMostChangeBytes / 2);
  EXPECT_LT(most, MapSaver::kMostChangeBytes * 2);
  EXPECT_GT(states, 1u);
  EXPECT_LT(states, 40u);
  ASSERT_TRUE(saver.SaveAll(replicas_, now_s, [] {}).ok());
  EXPECT_EQ(StoredRevision(), map_.revision());
}

TEST_F(MapSaverTest, ANewOwnersStateIsStoredWhole) {
  MapSaver saver(store_.get(), kIntervalS);
  Grow(&saver, 1);
  while (Step(&saver, 0)) continue;
  Begin(&saver, 2);
  EXPECT_FALSE(Step(&saver, MapSaver::kStateIntervalS - 0.1)) << "not at once after the last";
  EXPECT_TRUE(Step(&saver, MapSaver::kStateIntervalS));
  EXPECT_EQ(store_->Load()->maps.at(0).snapshot.epoch, 2u);
  EXPECT_TRUE(saver.IsComplete(replicas_));
}

/// It is in the changes, and its data is no longer to be had.
TEST_F(MapSaverTest, AKeyFrameThatCameAndWentBetweenTwoPieces) {
  MapSaver saver(store_.get(), kIntervalS);
  Grow(&saver, 3);
  while (Step(&saver, 0)) continue;
  Grow(&saver, 1);
  const KeyFrameId last = map_.keyframes().rbegin()->first;
  map_.RemoveKeyFrame(last);
  Follow(&saver, map_.TakeDelta());
  while (Step(&saver, 5)) continue;
  EXPECT_TRUE(saver.IsComplete(replicas_));
  EXPECT_EQ(StoredRevision(), map_.revision());
  EXPECT_FALSE(store_->HasKeyFrame(last));
}

TEST_F(MapSaverTest, SaveAllWaitsForNothingAndStoresStates) {
  MapSaver saver(store_.get(), kIntervalS);
  Grow(&saver, 1);
  int pieces = 0;
  ASSERT_TRUE(saver.SaveAll(replicas_, 0.1, [&] { ++pieces; }).ok());
  EXPECT_EQ(pieces, 2);
  Grow(&saver, 0);
  ASSERT_TRUE(Step(&saver, 0.1));
  ASSERT_GT(ChangeBytes(), 0u);
  Grow(&saver, 60);
  ASSERT_TRUE(saver.SaveAll(replicas_, 0.2, [&] { ++pieces; }).ok());
  EXPECT_EQ(pieces, 2 + 4);
  EXPECT_EQ(ChangeBytes(), 0u);
  EXPECT_EQ(StoredRevision(), 3u);
  EXPECT_TRUE(saver.IsComplete(replicas_));
}

/// As when the disk was full for a while.
TEST_F(MapSaverTest, GoesOnWithTheStateAfterManyChangesThatCouldNotBeStored) {
  MapSaver saver(store_.get(), kIntervalS);
  Grow(&saver, 1);
  while (Step(&saver, 0)) continue;
  for (size_t i = 0; i < MapSaver::kMostWaiting + 10; ++i) Grow(&saver, 0);
  EXPECT_TRUE(Step(&saver, 10));
  EXPECT_EQ(ChangeBytes(), 0u);
  EXPECT_EQ(StoredRevision(), map_.revision());
}

TEST_F(MapSaverTest, NamesEachKeyFrameOnceThatItStored) {
  MapSaver saver(store_.get(), kIntervalS);
  Grow(&saver, 28);  // and the two of the beginning
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
    Grow(&saver, 5);
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
  Grow(&saver, 1);
  saver.Restore(map_.id(), map_.epoch(), map_.revision());
  EXPECT_TRUE(saver.IsComplete(replicas_));
  Step(&saver, 10);
  EXPECT_EQ(store_->num_keyframes(), 0u);
}

}  // namespace
}  // namespace portolan
