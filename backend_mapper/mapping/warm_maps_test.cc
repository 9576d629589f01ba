#include "mapping/warm_maps.h"

#include <gtest/gtest.h>

#include "map/random_edits.h"

namespace portolan {
namespace {

const ProcessId kSelf(3, 2, 1), kOwner(3, 1, 1), kServer(0, 9, 1), kOthersMapper(4, 1, 1);

/// A mapper that stands by, and the owner of a map that changes.
class WarmMapsTest : public ::testing::Test {
 protected:
  void Grant(MapId map, ProcessId owner, Epoch epoch = 1) {
    Command command;
    command.kind = CommandKind::kGrantOwnership;
    command.sender = kServer;
    command.map = map;
    command.epoch = epoch;
    command.owner = owner;
    warm_.OnCommand(command);
  }
  void Say(CommandKind kind, MapId map, MapId other = MapId()) {
    Command command;
    command.kind = kind;
    command.sender = kServer;
    command.map = map;
    command.other = other;
    warm_.OnCommand(command);
  }
  /// The owner makes changes, of which all hear.
  void Change() {
    for (int i = 0; i < 10; ++i) edits_.Next();
    const MapDelta delta = map_.TakeDelta();
    for (const auto& [id, keyframe] : map_.keyframes()) warm_.AddKeyFrame(map_.id(), *keyframe.data);
    Hear(delta);
  }
  void Hear(const MapDelta& delta) {
    for (MapDeltaChunk& chunk : SplitDelta(delta, 1000)) warm_.AddChunk(std::move(chunk));
    warm_.Update(0);
  }
  void Announce() {
    MapperState state;
    state.process = kOwner;
    state.map = map_.id();
    state.epoch = map_.epoch();
    state.revision = map_.revision();
    warm_.OnMapperState(state);
  }

  Map map_{MapId(3, 1, 1), 1};
  RandomEdits edits_{5, &map_};
  WarmMaps warm_{kSelf};
};

TEST_F(WarmMapsTest, WhatTheOwnerHasIsHereToGoOnWith) {
  Grant(map_.id(), kOwner);
  for (int i = 0; i < 5; ++i) Change();
  ASSERT_NE(warm_.current(), nullptr);
  EXPECT_TRUE(HasSameContent(MeasureMap(*warm_.current()), MeasureMap(map_)));
  EXPECT_TRUE(warm_.IsOwner(kOwner));
  EXPECT_EQ(warm_.Lag(), 0u);
  const auto taken = warm_.Take(map_.id());
  ASSERT_TRUE(taken);
  EXPECT_EQ(HashMap(taken->map()), HashMap(map_));
  for (const auto& [id, keyframe] : map_.keyframes()) EXPECT_NE(taken->FindKeyFrameData(id), nullptr);
  EXPECT_FALSE(warm_.IsOwner(kOwner));
  EXPECT_FALSE(warm_.Take(map_.id())) << "once";
}

TEST_F(WarmMapsTest, NewsAreToldOnceAndAllOfThemOnDemand) {
  Grant(map_.id(), kOwner);
  EXPECT_TRUE(warm_.TakeNews().empty());
  Change();
  const auto news = warm_.TakeNews();
  ASSERT_EQ(news.size(), 1u);
  EXPECT_TRUE(HasSameContent(news[0], MeasureMap(map_)));
  EXPECT_TRUE(warm_.TakeNews().empty());
  warm_.TellAllAgain();
  EXPECT_EQ(warm_.TakeNews().size(), 1u);
  Change();
  EXPECT_EQ(warm_.TakeNews()[0].revision, map_.revision());
}

TEST_F(WarmMapsTest, OneThatComesLateAsksForTheMap) {
  for (int i = 0; i < 10; ++i) edits_.Next();
  static_cast<void>(map_.TakeDelta());
  Announce();
  EXPECT_EQ(warm_.num_missing(), 1u);
  EXPECT_TRUE(warm_.Update(1).empty());
  const auto requests = warm_.Update(1 + 2 * ReplicaSet::kAnnouncedPatienceS);
  ASSERT_EQ(requests.size(), 1u);
  EXPECT_EQ(requests[0].asker, kSelf);
  for (const auto& [id, keyframe] : map_.keyframes()) warm_.AddKeyFrame(map_.id(), *keyframe.data);
  Hear(map_.Snapshot());
  EXPECT_EQ(warm_.num_missing(), 0u);
  EXPECT_EQ(warm_.TakeNews().size(), 1u);
}

TEST_F(WarmMapsTest, MapsOfOthersAndDormantOnesAreNotFollowed) {
  Change();
  EXPECT_EQ(warm_.num_maps(), 0u) << "nobody has said whose it is";
  Grant(map_.id(), kOthersMapper);
  Change();
  EXPECT_EQ(warm_.num_maps(), 0u);
  Announce();
  EXPECT_EQ(warm_.num_maps(), 1u);
  Grant(map_.id(), kServer, 2);
  EXPECT_EQ(warm_.num_maps(), 0u);
}

TEST_F(WarmMapsTest, AMapThatIsNoMoreIsForgotten) {
  const MapId into(3, 1, 2);
  Grant(map_.id(), kOwner);
  Grant(into, kOwner);
  Change();
  Say(CommandKind::kFuseMaps, into, map_.id());
  EXPECT_FALSE(warm_.Take(map_.id()));
  Say(CommandKind::kForgetMap, into);
  EXPECT_FALSE(warm_.IsOwner(kOwner));
}

}  // namespace
}  // namespace portolan
