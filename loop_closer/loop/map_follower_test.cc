#include "loop/map_follower.h"

#include <gtest/gtest.h>

#include <functional>

#include "map/random_edits.h"
#include "vocabulary/vocabulary_training.h"

namespace portolan {
namespace {

constexpr RobotId kRobot = 0;

/// A map's owner and a follower that hears of everything.
class MapFollowerTest : public ::testing::Test {
 protected:
  void SetUp() override { follower_.Follow(map_.id()); }
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
  MapFollower follower_{nullptr, kRobot};
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
  status.role = "backend_mapper";
  status.process = ProcessId(kRobot, 1, 1);
  status.map = map_.id();
  status.epoch = 1;
  status.revision = 9;
  follower_.OnStatus(status);
  EXPECT_TRUE(follower_.Maps().empty());
  follower_.DueRequests(0, ProcessId(0, 2, 1));
  EXPECT_EQ(follower_.DueRequests(5, ProcessId(0, 2, 1)).size(), 1u);
}

/// An atlas_server and other robots share the partition.
TEST_F(MapFollowerTest, FollowsTheMapsOfItsRobotAlone) {
  follower_ = MapFollower(nullptr, kRobot);
  const RobotId other_robot = 5;
  KeyFrameMessage message = Message(*edits_.data().begin()->second);
  EXPECT_TRUE(follower_.AddKeyFrame(message)) << "a copy, passed over";
  MapperState state;
  state.process = ProcessId(other_robot, 1, 1);
  state.map = map_.id();
  state.epoch = 1;
  state.revision = 3;
  follower_.OnMapperState(state);
  ProcessStatus status;
  status.process = ProcessId(kRobot, 1, 1);
  status.role = "atlas_server";
  status.map = map_.id();
  status.revision = 3;
  follower_.OnStatus(status);
  TrackerState tracker;
  tracker.process = ProcessId(other_robot, 1, 2);
  tracker.map = map_.id();
  follower_.OnTrackerState(tracker);
  Send(map_.TakeDelta());
  EXPECT_FALSE(follower_.IsFollowed(map_.id()));
  EXPECT_TRUE(follower_.Maps().empty());
  EXPECT_EQ(follower_.index().size(), 0u);

  // Each of these shows that the robot is in the map.
  const auto follows = [&](const std::function<void(MapFollower*)>& hear) {
    MapFollower follower(nullptr, kRobot);
    hear(&follower);
    return follower.IsFollowed(map_.id());
  };
  EXPECT_TRUE(follows([&](MapFollower* follower) {
    message.kind = KeyFrameKind::kInitialFirst;
    follower->AddKeyFrame(message);
  }));
  EXPECT_TRUE(follows([&](MapFollower* follower) {
    state.process = ProcessId(kRobot, 1, 1);
    follower->OnMapperState(state);
  }));
  EXPECT_TRUE(follows([&](MapFollower* follower) {
    status.role = "frontend_tracker";
    follower->OnStatus(status);
  }));
  EXPECT_TRUE(follows([&](MapFollower* follower) {
    tracker.process = ProcessId(kRobot, 1, 2);
    follower->OnTrackerState(tracker);
  }));
}

TEST_F(MapFollowerTest, FollowsTheLastMapsOnly) {
  Send(map_.TakeDelta());
  EXPECT_GT(follower_.index().size(), 0u);
  for (uint32_t i = 1; i < MapFollower::kMaxFollowed; ++i) follower_.Follow(MapId(0, 3, i));
  follower_.Follow(map_.id());
  follower_.Follow(MapId(0, 3, 100));
  EXPECT_TRUE(follower_.IsFollowed(map_.id())) << "it mattered lately";
  EXPECT_FALSE(follower_.IsFollowed(MapId(0, 3, 1)));
  for (uint32_t i = 1; i <= MapFollower::kMaxFollowed; ++i) follower_.Follow(MapId(0, 4, i));
  EXPECT_FALSE(follower_.IsFollowed(map_.id()));
  EXPECT_TRUE(follower_.Maps().empty());
  EXPECT_EQ(follower_.index().size(), 0u);
  EXPECT_FALSE(follower_.active_map().IsValid());
}

TEST_F(MapFollowerTest, TheActiveMapIsTheOneThatTheTrackerIsIn) {
  Send(map_.TakeDelta());
  EXPECT_EQ(follower_.active_map(), map_.id());
  TrackerState state;
  state.process = ProcessId(kRobot, 1, 2);
  state.map = MapId(0, 3, 1);
  follower_.OnTrackerState(state);
  EXPECT_EQ(follower_.active_map(), map_.id()) << "the other is not here yet";
  Map other(state.map, 1);
  RandomEdits edits(5, &other);
  for (const auto& [id, data] : edits.data()) {
    KeyFrameMessage message = Message(*data);
    message.map = other.id();
    follower_.AddKeyFrame(message);
  }
  for (const MapDeltaChunk& chunk : SplitDelta(other.TakeDelta(), 7)) follower_.AddChunk(chunk);
  follower_.ApplyPending();
  EXPECT_EQ(follower_.active_map(), other.id());
  edits_.Next();
  Send(map_.Snapshot());
  EXPECT_EQ(follower_.active_map(), other.id()) << "whatever changes";
  follower_.Remove(other.id());
  EXPECT_EQ(follower_.Maps().size(), 1u);
  EXPECT_NE(follower_.active_map(), other.id());
}

TEST_F(MapFollowerTest, AMapTakenIntoAnotherPassesItsKeyFramesOn) {
  Send(map_.TakeDelta());
  Map into(MapId(0, 3, 1), 1);
  Random random(4);
  const auto own = RandomEdits::MakeData(KeyFrameId(0, 3, 1), &random);
  into.AddKeyFrame(own, Rigid3d(), KeyFrameId());
  follower_.Follow(into.id());
  KeyFrameMessage message = Message(*own);
  message.map = into.id();
  follower_.AddKeyFrame(message);
  for (const MapDeltaChunk& chunk : SplitDelta(into.TakeDelta(), 7)) follower_.AddChunk(chunk);
  follower_.ApplyPending();

  follower_.Fuse(into.id(), map_.id());
  EXPECT_FALSE(follower_.IsFollowed(map_.id()));
  EXPECT_EQ(follower_.index().size(), 1u);
  for (const auto& [id, keyframe] : map_.keyframes())
    into.AddKeyFrame(keyframe.data, keyframe.camera_from_map, own->id);
  for (const MapDeltaChunk& chunk : SplitDelta(into.TakeDelta(), 7)) follower_.AddChunk(chunk);
  EXPECT_EQ(follower_.ApplyPending().size(), 1u);
  EXPECT_EQ(follower_.index().size(), into.keyframes().size());
  EXPECT_EQ(follower_.Hashes().at(into.id()), HashMap(into));
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
  follower_ = MapFollower(*vocabulary, kRobot);
  follower_.Follow(map_.id());
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
