#include "map/replica_set.h"

#include <gtest/gtest.h>

#include "map/random_edits.h"

namespace portolan {
namespace {

const ProcessId kAsker(0, 9, 1);
constexpr double kPatienceS = 1e-3 * MapReplica::kPatienceMs;

/// Two maps with an owner, edited in turn.
class ReplicaSetTest : public ::testing::Test {
 protected:
  static MapDelta Change(Map* map, RandomEdits* edits) {
    MapDelta delta;
    do {
      edits->Next();
      delta = map->TakeDelta();
    } while (delta.IsEmpty());
    return delta;
  }

  void SendData(const Map& map, const RandomEdits& edits) {
    for (const auto& [id, data] : edits.data()) set_.AddKeyFrameData(map.id(), data);
  }

  void FollowOneChange() {
    const MapDelta delta = Change(&a_, &edits_a_);
    SendData(a_, edits_a_);
    set_.AddDelta(delta);
  }

  void ExpectEqual(const Map& owner) {
    ASSERT_EQ(set_.replicas().count(owner.id()), 1u);
    EXPECT_EQ(HashMap(set_.replicas().at(owner.id()).map()), HashMap(owner));
    EXPECT_EQ(set_.replicas().at(owner.id()).map().revision(), owner.revision());
  }

  Map a_{MapId(0, 1, 1), 1}, b_{MapId(0, 1, 2), 1};
  RandomEdits edits_a_{1, &a_}, edits_b_{2, &b_};
  ReplicaSet set_;
};

TEST_F(ReplicaSetTest, FollowsSeveralMapsInChunks) {
  for (int round = 0; round < 40; ++round) {
    for (auto [map, edits] : {std::make_pair(&a_, &edits_a_), std::make_pair(&b_, &edits_b_)}) {
      const MapDelta delta = Change(map, edits);
      SendData(*map, *edits);
      for (const MapDeltaChunk& chunk : SplitDelta(delta, 3)) set_.AddChunk(chunk);
    }
    EXPECT_EQ(set_.ApplyPending().size(), 2u);
  }
  ExpectEqual(a_);
  ExpectEqual(b_);
  EXPECT_EQ(set_.counters().applied, 80u);
  EXPECT_TRUE(set_.DueRequests(0, kAsker).empty());
  EXPECT_TRUE(set_.DueRequests(100, kAsker).empty());
}

TEST_F(ReplicaSetTest, AsksForASnapshotAfterAGapWithPatience) {
  FollowOneChange();
  Change(&a_, &edits_a_);  // lost
  set_.AddDelta(Change(&a_, &edits_a_));
  SendData(a_, edits_a_);
  set_.ApplyPending();
  EXPECT_TRUE(set_.DueRequests(10, kAsker).empty());
  EXPECT_TRUE(set_.DueRequests(10 + 0.9 * kPatienceS, kAsker).empty());
  const auto requests = set_.DueRequests(10 + kPatienceS, kAsker);
  ASSERT_EQ(requests.size(), 1u);
  EXPECT_EQ(requests[0].map, a_.id());
  EXPECT_EQ(requests[0].asker, kAsker);
  EXPECT_EQ(requests[0].have_revision, 1u);
  EXPECT_TRUE(set_.DueRequests(10 + kPatienceS + 0.9 * ReplicaSet::kRequestIntervalS, kAsker).empty())
      << "not more often than once a second";
  EXPECT_EQ(set_.DueRequests(10 + kPatienceS + ReplicaSet::kRequestIntervalS, kAsker).size(), 1u);

  set_.AddDelta(a_.Snapshot());
  set_.ApplyPending();
  ExpectEqual(a_);
  EXPECT_TRUE(set_.DueRequests(100, kAsker).empty());
}

TEST_F(ReplicaSetTest, NoticesThatTheLastDeltaIsMissing) {
  FollowOneChange();
  Change(&a_, &edits_a_);  // lost, and nothing comes after it
  set_.ApplyPending();
  EXPECT_TRUE(set_.DueRequests(0, kAsker).empty());
  set_.Announce(a_.id(), a_.epoch(), a_.revision());
  EXPECT_EQ(set_.Lag(a_.id()), 1u);
  EXPECT_TRUE(set_.IsBehind(a_.id()));
  EXPECT_FALSE(set_.IsBehind(b_.id()));
  EXPECT_TRUE(set_.DueRequests(1, kAsker).empty());
  EXPECT_EQ(set_.DueRequests(1 + ReplicaSet::kAnnouncedPatienceS, kAsker).size(), 1u);
  SendData(a_, edits_a_);
  set_.AddDelta(a_.Snapshot());
  set_.ApplyPending();
  EXPECT_EQ(set_.Lag(a_.id()), 0u);
  EXPECT_FALSE(set_.IsBehind(a_.id()));
  EXPECT_TRUE(set_.DueRequests(100, kAsker).empty());
}

TEST_F(ReplicaSetTest, LateComerLearnsOfAMapByAnnouncement) {
  Change(&a_, &edits_a_);
  EXPECT_TRUE(set_.IsEmpty(a_.id()));
  set_.Announce(a_.id(), 1, a_.revision());
  EXPECT_FALSE(set_.IsEmpty(a_.id()));
  set_.DueRequests(0, kAsker);
  ASSERT_EQ(set_.DueRequests(5, kAsker).size(), 1u);
  for (int i = 0; i < 100; ++i) edits_a_.Edit(RandomEdits::kAddKeyFrame);
  static_cast<void>(a_.TakeDelta());
  SendData(a_, edits_a_);  // a hundred keyframes ahead of the snapshot: all are kept
  set_.AddDelta(a_.Snapshot());
  set_.ApplyPending();
  ExpectEqual(a_);
}

TEST_F(ReplicaSetTest, AnOlderAnnouncementChangesNothing) {
  set_.Announce(a_.id(), 2, 5);
  set_.Announce(a_.id(), 1, 50);
  set_.Announce(a_.id(), 2, 4);
  a_.SetEpoch(2);
  FollowOneChange();
  set_.ApplyPending();
  EXPECT_EQ(set_.Lag(a_.id()), 4u);
}

TEST_F(ReplicaSetTest, ForgetsDataThatNoDeltaUses) {
  FollowOneChange();
  set_.ApplyPending();
  Random random(4);
  const size_t used = set_.replicas().at(a_.id()).map().keyframes().size();
  for (uint32_t i = 0; i < 200; ++i)
    set_.AddKeyFrameData(a_.id(), RandomEdits::MakeData(KeyFrameId(0, 1, 1000 + i), &random));
  const auto& data = set_.replicas().at(a_.id()).keyframe_data();
  EXPECT_LE(data.size(), used + ReplicaSet::kMaxUnusedData);
  EXPECT_EQ(data.count(KeyFrameId(0, 1, 1199)), 1u) << "the newest is kept";
  for (const auto& [id, keyframe] : a_.keyframes()) EXPECT_EQ(data.count(id), 1u);
}

/// Someone announces maps that never come, and sends their keyframes without end.
TEST_F(ReplicaSetTest, AnAnnouncementDoesNotLetDataFillMemory) {
  FollowOneChange();
  set_.ApplyPending();
  set_.Announce(a_.id(), 1, 1000000);
  set_.Announce(b_.id(), 1, 1000000);
  Random random(4);
  const auto any = RandomEdits::MakeData(KeyFrameId(0, 1, 1), &random);
  const uint32_t sent = ReplicaSet::kMaxExpectedData;
  for (uint32_t i = 0; i < sent; ++i) {
    for (const MapId map : {a_.id(), b_.id()}) {
      KeyFrameData data;  // nothing but a name: two times 8192 of them take little
      data.id = KeyFrameId(0, 1, 1000 + i);
      data.camera = any->camera;
      set_.AddKeyFrameData(map, std::make_shared<const KeyFrameData>(std::move(data)));
    }
  }
  const auto& of_a = set_.replicas().at(a_.id()).keyframe_data();
  const auto& of_b = set_.replicas().at(b_.id()).keyframe_data();
  EXPECT_EQ(of_a.size() + of_b.size(), ReplicaSet::kMaxExpectedData + a_.keyframes().size());
  EXPECT_EQ(of_a.count(KeyFrameId(0, 1, 1000 + sent - 1)), 1u) << "the newest is kept";
  for (const auto& [id, keyframe] : a_.keyframes()) EXPECT_EQ(of_a.count(id), 1u);
}

/// The owner of two maps takes one into the other: no data comes again.
TEST_F(ReplicaSetTest, AMapFindsKeyFramesThatCameFromAnother) {
  a_ = Map(a_.id(), 1);
  Random random(8);
  const auto own = RandomEdits::MakeData(KeyFrameId(0, 7, 1), &random);
  a_.AddKeyFrame(own, Rigid3d(), KeyFrameId());
  set_.AddKeyFrameData(a_.id(), own);
  set_.AddDelta(a_.TakeDelta());
  for (int i = 0; i < 20; ++i) edits_b_.Next();
  static_cast<void>(b_.TakeDelta());
  SendData(b_, edits_b_);
  set_.AddDelta(b_.Snapshot());
  EXPECT_EQ(set_.ApplyPending().size(), 2u);

  for (const auto& [id, keyframe] : b_.keyframes())
    a_.AddKeyFrame(keyframe.data, keyframe.camera_from_map, KeyFrameId());
  for (const auto& [id, keyframe] : b_.keyframes())
    a_.SetParent(id, keyframe.parent.IsValid() ? keyframe.parent : own->id);
  set_.AddDelta(a_.TakeDelta());
  EXPECT_EQ(set_.ApplyPending().size(), 1u);
  ExpectEqual(a_);
  set_.Remove(b_.id());
  EXPECT_EQ(set_.replicas().count(b_.id()), 0u);
  for (const auto& [id, keyframe] : b_.keyframes())
    EXPECT_EQ(set_.replicas().at(a_.id()).FindKeyFrameData(id), keyframe.data);
}

TEST_F(ReplicaSetTest, DataOfAMapTakenInPassesOnBeforeTheDeltaThatNamesIt) {
  set_.Announce(a_.id(), 1, 1);
  SendData(b_, edits_b_);
  set_.AddDelta(b_.TakeDelta());
  set_.ApplyPending();
  set_.Remove(b_.id(), a_.id());
  for (const auto& [id, keyframe] : b_.keyframes())
    EXPECT_EQ(set_.replicas().at(a_.id()).FindKeyFrameData(id), keyframe.data);
  set_.Remove(a_.id(), b_.id());  // into an unknown one: all is forgotten
  EXPECT_TRUE(set_.replicas().empty());
}

TEST_F(ReplicaSetTest, WhatComesOfARemovedMapIsIgnored) {
  FollowOneChange();
  set_.Announce(a_.id(), 2, 1);
  set_.ApplyPending();
  set_.Remove(a_.id());
  FollowOneChange();
  set_.Announce(a_.id(), 2, 9);
  set_.ApplyPending();
  EXPECT_EQ(set_.replicas().count(a_.id()), 0u);
  EXPECT_TRUE(set_.IsEmpty(a_.id()));
  EXPECT_TRUE(set_.DueRequests(100, kAsker).empty());
  EXPECT_EQ(set_.RemovedEpoch(a_.id()), 2u);
  EXPECT_EQ(set_.RemovedEpoch(b_.id()), 0u);
  // Imported again, it has a new owner.
  a_.SetEpoch(3);
  set_.AddDelta(a_.Snapshot());
  SendData(a_, edits_a_);
  set_.ApplyPending();
  ExpectEqual(a_);
}

TEST_F(ReplicaSetTest, ATakenReplicaGoesOnElsewhere) {
  EXPECT_FALSE(set_.Take(a_.id()));
  FollowOneChange();
  set_.ApplyPending();
  const auto taken = set_.Take(a_.id());
  ASSERT_TRUE(taken);
  EXPECT_EQ(HashMap(taken->map()), HashMap(a_));
  EXPECT_EQ(set_.replicas().count(a_.id()), 0u);
  EXPECT_TRUE(set_.DueRequests(100, kAsker).empty());
}

TEST_F(ReplicaSetTest, AForgottenMapIsFollowedAgain) {
  FollowOneChange();
  set_.ApplyPending();
  set_.Forget(a_.id());
  set_.Remove(MapId(9, 9, 9));
  EXPECT_TRUE(set_.replicas().empty());
  SendData(a_, edits_a_);
  set_.AddDelta(a_.Snapshot());
  set_.ApplyPending();
  ExpectEqual(a_);
}

TEST_F(ReplicaSetTest, InventedMapsPushOutNoneThatIs) {
  FollowOneChange();
  set_.ApplyPending();
  Random random(5);
  constexpr uint32_t kInvented = 20 * ReplicaSet::kMaxEmptyMaps;
  for (uint32_t i = 0; i < kInvented; ++i) {
    if (i % 2 == 0) set_.AddKeyFrameData(MapId(0, 66, i), RandomEdits::MakeData(KeyFrameId(0, 66, i), &random));
    if (i % 2 == 1) set_.Announce(MapId(0, 66, i), 1, 1);
    set_.Announce(b_.id(), 1, 1);  // one that begins, and is heard of again and again
    EXPECT_LE(set_.replicas().size(), ReplicaSet::kMaxEmptyMaps + 1);
  }
  EXPECT_EQ(set_.replicas().count(MapId(0, 66, kInvented - 1)), 1u);
  EXPECT_EQ(set_.replicas().count(MapId(0, 66, 0)), 0u);
  ExpectEqual(a_);
  SendData(b_, edits_b_);
  set_.AddDelta(b_.TakeDelta());
  FollowOneChange();
  set_.ApplyPending();
  ExpectEqual(a_);
  ExpectEqual(b_);
}

TEST_F(ReplicaSetTest, AReplicaIsHandedOutAndGoneOnWithLater) {
  FollowOneChange();
  set_.ApplyPending();
  std::optional<MapReplica> taken = set_.Take(a_.id());
  ASSERT_TRUE(taken);
  EXPECT_EQ(set_.counters().applied, 1u) << "what was, was";
  MapReplica other(a_.id());
  for (const auto& [id, data] : edits_a_.data()) other.AddKeyFrameData(data);
  other.AddDelta(a_.Snapshot());
  other.ApplyPending();
  set_.Put(std::move(other));
  ExpectEqual(a_);
  FollowOneChange();
  set_.ApplyPending();
  ExpectEqual(a_);
}

TEST_F(ReplicaSetTest, ThereAreMapsWithoutEndForNobody) {
  for (uint32_t i = 0; i <= ReplicaSet::kMaxMaps; ++i) {
    MapDelta snapshot;
    snapshot.map = MapId(0, 66, i);
    snapshot.epoch = snapshot.revision = 1;
    set_.AddDelta(snapshot);
    set_.ApplyPending();
  }
  EXPECT_EQ(set_.replicas().size(), ReplicaSet::kMaxMaps);
  EXPECT_EQ(set_.counters().rejected, 1u);
}

TEST_F(ReplicaSetTest, AsksLessOftenForWhatNeverComes) {
  FollowOneChange();
  set_.ApplyPending();
  set_.Announce(a_.id(), a_.epoch(), a_.revision() + 1000);  // of nobody who owns the map
  const auto requests_within = [this](double from_s, double to_s) {
    size_t requests = 0;
    for (double now_s = from_s; now_s < to_s; now_s += 0.25) {
      requests += set_.DueRequests(now_s, kAsker).size();
      set_.AddDelta(a_.Snapshot());
      set_.ApplyPending();
    }
    return requests;
  };
  EXPECT_GE(requests_within(0, 10), 5u);
  EXPECT_LE(requests_within(100, 200), 200 / ReplicaSet::kMaxRequestIntervalS);
}

}  // namespace
}  // namespace portolan
