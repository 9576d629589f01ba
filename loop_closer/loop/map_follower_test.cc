#include "loop/map_follower.h"

#include <gtest/gtest.h>

#include "map/random_edits.h"
#include "vocabulary/vocabulary_training.h"

namespace portolan {
namespace {

/// A map's owner and a follower that hears of everything.
class MapFollowerTest : public ::testing::Test {
 protected:
  KeyFrameMessage Message(const KeyFrameData& data) const {
    KeyFrameMessage message;
    message.kind = KeyFrameKind::kCopy;
    message.map = map_.id();
    message.data.id = data.id;
    message.data.camera = data.camera;
    message.data.pyramid = data.pyramid;
    message.data.features = data.features;
    return message;
  }
  void SendKeyFrames() {
    for (const auto& [id, data] : edits_.data()) ASSERT_TRUE(follower_.AddKeyFrame(Message(*data)));
  }
  std::vector<MapDelta> Send(const MapDelta& delta) {
    SendKeyFrames();
    for (const MapDeltaChunk& chunk : SplitDelta(delta, 7)) follower_.AddChunk(chunk);
    return follower_.ApplyPending();
  }

  /// The index has the keyframes of the map and no others.
  void ExpectIndexMatches() {
    EXPECT_EQ(follower_.index().size(), map_.keyframes().size());
    for (const auto& [id, keyframe] : map_.keyframes()) EXPECT_NE(follower_.index().Find(id), nullptr) << ToString(id);
  }

  Map map_{MapId(0, 1, 1), 1};
  RandomEdits edits_{1, &map_};
  MapFollower follower_{nullptr};
};

TEST_F(MapFollowerTest, FollowsAMapThroughAllChanges) {
  for (int round = 0; round < 60; ++round) {
    for (int i = 0; i < 5; ++i) edits_.Next();
    const MapDelta delta = map_.TakeDelta();
    if (delta.IsEmpty()) continue;
    ASSERT_EQ(Send(delta).size(), 1u);
    ExpectIndexMatches();
  }
  ASSERT_EQ(follower_.Hashes().size(), 1u);
  EXPECT_EQ(follower_.Hashes().at(map_.id()), HashMap(map_));
  EXPECT_EQ(follower_.active_map(), map_.id());
  EXPECT_GT(edits_.data().size(), map_.keyframes().size()) << "the example removes keyframes";
}

TEST_F(MapFollowerTest, ASnapshotAfterLostDeltasSetsTheIndexRight) {
  Send(map_.TakeDelta());
  for (int i = 0; i < 300; ++i) {
    edits_.Next();
    static_cast<void>(map_.TakeDelta());  // lost
  }
  MapperState state;
  state.map = map_.id();
  state.epoch = 1;
  state.revision = map_.revision();
  follower_.OnMapperState(state);  // so that it expects a snapshot, and keeps the data that comes ahead of it
  Send(map_.Snapshot());
  ExpectIndexMatches();
  EXPECT_EQ(follower_.Hashes().at(map_.id()), HashMap(map_));
}

TEST_F(MapFollowerTest, SummarizesTheMap) {
  for (int i = 0; i < 50; ++i) edits_.Next();
  Send(map_.TakeDelta());
  size_t edges = 0;
  for (const auto& [a, keyframe_a] : map_.keyframes()) {
    for (const auto& [b, keyframe_b] : map_.keyframes()) edges += a < b && map_.Covisibility(a, b) > 0;
  }
  const MapFollower::Summary summary = follower_.Summarize(map_.id());
  EXPECT_EQ(summary.map, map_.id());
  EXPECT_EQ(summary.epoch, 1u);
  EXPECT_EQ(summary.revision, 1u);
  EXPECT_EQ(summary.lag, 0u);
  EXPECT_EQ(summary.keyframes, map_.keyframes().size());
  EXPECT_EQ(summary.points, map_.points().size());
  EXPECT_EQ(summary.covisibility_edges, edges);
  EXPECT_GT(edges, 0u);
}

TEST_F(MapFollowerTest, TellsHowFarItIsBehindAndAsks) {
  Send(map_.TakeDelta());
  MapperState state;
  state.map = map_.id();
  state.epoch = 1;
  state.revision = 4;
  follower_.OnMapperState(state);
  EXPECT_EQ(follower_.Summarize(map_.id()).lag, 3u);
  EXPECT_TRUE(follower_.DueRequests(0, ProcessId(0, 2, 1)).empty());
  EXPECT_EQ(follower_.DueRequests(5, ProcessId(0, 2, 1)).size(), 1u);
}

TEST_F(MapFollowerTest, HearsOfAMapThatWasThereBefore) {
  ProcessStatus status;
  status.map = map_.id();
  status.epoch = 1;
  status.revision = 9;
  follower_.OnStatus(status);
  EXPECT_TRUE(follower_.Maps().empty());
  follower_.DueRequests(0, ProcessId(0, 2, 1));
  EXPECT_EQ(follower_.DueRequests(5, ProcessId(0, 2, 1)).size(), 1u);
}

TEST_F(MapFollowerTest, RefusesKeyFramesOfNoMap) {
  KeyFrameMessage message = Message(*edits_.data().begin()->second);
  message.map = MapId();
  EXPECT_FALSE(follower_.AddKeyFrame(message));
}

TEST_F(MapFollowerTest, IndexesTheWordsOfAVocabularyAndRefusesOthers) {
  for (int i = 0; i < 10; ++i) edits_.Edit(RandomEdits::kAddKeyFrame);
  std::vector<std::vector<Descriptor>> images;
  for (const auto& [id, data] : edits_.data()) images.push_back(data->features.descriptors);
  VocabularyTrainingOptions options;
  options.branching = 5;
  options.depth = 3;
  const auto vocabulary = TrainVocabulary(images, options, nullptr);
  ASSERT_TRUE(vocabulary.ok()) << vocabulary.error().message;
  follower_ = MapFollower(*vocabulary);
  KeyFrameMessage message = Message(*edits_.data().begin()->second);
  message.vocabulary_hash = (*vocabulary)->hash() + 1;
  EXPECT_FALSE(follower_.AddKeyFrame(message));
  for (const auto& [id, data] : edits_.data()) {
    KeyFrameMessage right = Message(*data);
    right.vocabulary_hash = (*vocabulary)->hash();
    EXPECT_TRUE(follower_.AddKeyFrame(right));
  }
  for (const MapDeltaChunk& chunk : SplitDelta(map_.TakeDelta(), 7)) follower_.AddChunk(chunk);
  follower_.ApplyPending();
  for (const auto& [id, keyframe] : map_.keyframes()) {
    const BowVector* bow = follower_.index().Find(id);
    ASSERT_NE(bow, nullptr);
    ASSERT_FALSE(bow->empty());
    EXPECT_EQ(follower_.index().Query(*bow).front().keyframe, id) << "a keyframe is most like itself";
  }
}

}  // namespace
}  // namespace portolan
