#include "map/map_replica.h"

#include <gmock/gmock.h>

#include <algorithm>

#include "map/random_edits.h"

namespace portolan {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;

class ReplicaTest : public ::testing::Test {
 protected:
  ReplicaTest() : edits_(21, &owner_) {}

  /// The owner's next deltas. Keyframes stay, so that all data can be given first.
  std::vector<MapDelta> MakeDeltas(int count) {
    std::vector<MapDelta> deltas;
    while (static_cast<int>(deltas.size()) < count) {
      for (int i = 0; i < 5; ++i) edits_.Next();
      MapDelta delta = owner_.TakeDelta();
      if (!delta.IsEmpty()) deltas.push_back(std::move(delta));
    }
    return deltas;
  }
  void GiveData() {
    for (const auto& [id, data] : edits_.data()) replica_.AddKeyFrameData(data);
  }
  void GiveAll(const std::vector<MapDelta>& deltas) {
    GiveData();
    for (const MapDelta& delta : deltas) replica_.AddDelta(delta);
    static_cast<void>(replica_.ApplyPending());
  }
  void ExpectInStep() {
    EXPECT_EQ(HashMap(replica_.map()), HashMap(owner_));
    EXPECT_EQ(replica_.map().revision(), owner_.revision());
    EXPECT_FALSE(replica_.NeedsSnapshot());
    EXPECT_EQ(replica_.waiting(), 0u);
  }

  Map owner_{MapId(0, 1, 1), 2};
  RandomEdits edits_;
  MapReplica replica_{MapId(0, 1, 1)};
};

TEST_F(ReplicaTest, DeltasInAnyOrderAndRepeatedGiveTheSameMap) {
  std::vector<MapDelta> deltas = MakeDeltas(30);
  GiveData();
  Random random(4);
  std::vector<MapDelta> given = deltas;
  given.insert(given.end(), deltas.begin(), deltas.begin() + 10);
  for (size_t i = given.size(); i > 1; --i) std::swap(given[i - 1], given[random.Below(i)]);
  std::vector<Revision> applied;
  for (const MapDelta& delta : given) {
    replica_.AddDelta(delta);
    for (const MapDelta& done : replica_.ApplyPending()) applied.push_back(done.revision);
  }
  ExpectInStep();
  EXPECT_TRUE(std::is_sorted(applied.begin(), applied.end()));
  EXPECT_EQ(applied.size(), deltas.size());
  EXPECT_EQ(replica_.counters().applied, deltas.size());
  EXPECT_EQ(replica_.counters().repeated, 10u);
}

TEST_F(ReplicaTest, WaitsForKeyFrameData) {
  const std::vector<MapDelta> deltas = MakeDeltas(5);
  for (const MapDelta& delta : deltas) replica_.AddDelta(delta);
  EXPECT_THAT(replica_.ApplyPending(), IsEmpty());
  EXPECT_TRUE(replica_.NeedsSnapshot());
  EXPECT_THAT(replica_.last_problem(), HasSubstr("is missing"));
  GiveData();
  EXPECT_EQ(replica_.ApplyPending().size(), 5u);
  ExpectInStep();
}

TEST_F(ReplicaTest, FindsKeyFrameDataElsewhereAndKeepsIt) {
  for (const MapDelta& delta : MakeDeltas(5)) replica_.AddDelta(delta);
  EXPECT_THAT(replica_.ApplyPending([](KeyFrameId) { return nullptr; }), IsEmpty());
  EXPECT_THAT(replica_.last_problem(), HasSubstr("is missing"));
  EXPECT_EQ(replica_.ApplyPending(edits_.FindData()).size(), 5u);
  ExpectInStep();
  for (const auto& [id, keyframe] : owner_.keyframes()) EXPECT_EQ(replica_.FindKeyFrameData(id), keyframe.data);
}

TEST_F(ReplicaTest, AGapAsksForASnapshotWhichClosesIt) {
  std::vector<MapDelta> deltas = MakeDeltas(10);
  deltas.erase(deltas.begin() + 4);
  GiveAll(deltas);
  EXPECT_TRUE(replica_.NeedsSnapshot());
  EXPECT_EQ(replica_.map().revision(), 4u);
  const SnapshotRequest request = replica_.MakeRequest(ProcessId(0, 1, 9));
  EXPECT_EQ(request.map, owner_.id());
  EXPECT_EQ(request.have_revision, 4u);
  EXPECT_EQ(request.have_keyframes.size(), replica_.keyframe_data().size());
  replica_.AddDelta(owner_.Snapshot());
  EXPECT_EQ(replica_.ApplyPending().size(), 1u);
  ExpectInStep();
}

TEST_F(ReplicaTest, DeltasBeyondTheSnapshotGoOnFromIt) {
  const std::vector<MapDelta> missed = MakeDeltas(10);
  const MapDelta snapshot = owner_.Snapshot();
  const std::vector<MapDelta> later = MakeDeltas(5);
  GiveData();
  for (const MapDelta& delta : later) replica_.AddDelta(delta);
  EXPECT_THAT(replica_.ApplyPending(), IsEmpty());
  EXPECT_TRUE(replica_.NeedsSnapshot());
  replica_.AddDelta(snapshot);
  EXPECT_EQ(replica_.ApplyPending().size(), 6u);
  ExpectInStep();
}

TEST_F(ReplicaTest, DeltasOfAnOlderEpochAreIgnored) {
  GiveAll(MakeDeltas(5));
  MapDelta old = MakeDeltas(1)[0];
  old.epoch = 1;
  const uint64_t before = HashMap(replica_.map());
  replica_.AddDelta(old);
  old.base_revision = 0;  // not even as a snapshot
  replica_.AddDelta(old);
  EXPECT_THAT(replica_.ApplyPending(), IsEmpty());
  EXPECT_EQ(replica_.counters().stale_epoch, 2u);
  EXPECT_EQ(HashMap(replica_.map()), before);
  EXPECT_FALSE(replica_.NeedsSnapshot());
}

/// The new owner began from an older state than the replica has: same revision, other content.
TEST_F(ReplicaTest, ANewEpochStartsFromASnapshot) {
  GiveAll(MakeDeltas(4));
  Map next_owner = owner_;
  next_owner.SetEpoch(3);
  GiveAll(MakeDeltas(1));
  next_owner.SetPosition(next_owner.SortedPointIds()[0], {7, 7, 7});
  const MapDelta first = next_owner.TakeDelta();
  ASSERT_EQ(first.revision, replica_.map().revision());
  next_owner.SetPosition(next_owner.SortedPointIds()[0], {8, 8, 8});
  const MapDelta second = next_owner.TakeDelta();
  ASSERT_EQ(second.base_revision, replica_.map().revision());
  replica_.AddDelta(first);
  replica_.AddDelta(second);
  EXPECT_THAT(replica_.ApplyPending(), IsEmpty());
  EXPECT_TRUE(replica_.NeedsSnapshot());
  replica_.AddDelta(next_owner.Snapshot());
  EXPECT_EQ(replica_.ApplyPending().size(), 1u);
  EXPECT_EQ(HashMap(replica_.map()), HashMap(next_owner));
  EXPECT_EQ(replica_.map().epoch(), 3u);
  EXPECT_EQ(replica_.waiting(), 0u);
}

TEST_F(ReplicaTest, SnapshotTellsWhatVanished) {
  GiveAll(MakeDeltas(20));
  const Map before = replica_.map();
  // Keyframes go while the replica hears nothing.
  for (int i = 0; i < 200; ++i) edits_.Next();
  static_cast<void>(owner_.TakeDelta());
  GiveData();
  replica_.AddDelta(owner_.Snapshot());
  const std::vector<MapDelta> applied = replica_.ApplyPending();
  ASSERT_EQ(applied.size(), 1u);
  ExpectInStep();
  size_t vanished = 0;
  for (const auto& [id, keyframe] : before.keyframes()) vanished += owner_.FindKeyFrame(id) == nullptr ? 1 : 0;
  ASSERT_GT(vanished, 0u);
  EXPECT_EQ(applied[0].removed_keyframes.size(), vanished);
  for (const auto& removed : applied[0].removed_keyframes) {
    EXPECT_NE(owner_.FindKeyFrame(removed.anchor), nullptr);
    const Rigid3d expected =
        before.keyframe(removed.id).camera_from_map * before.keyframe(removed.anchor).camera_from_map.Inverse();
    EXPECT_LT((removed.removed_from_anchor.translation - expected.translation).norm(), 1e-12);
    EXPECT_EQ(replica_.FindKeyFrameData(removed.id), nullptr);
  }
}

TEST_F(ReplicaTest, AWrongDeltaStopsTheReplicaUntilASnapshotComes) {
  GiveAll(MakeDeltas(5));
  MapDelta wrong = MakeDeltas(1)[0];
  wrong.points.push_back({MapPointId(0, 1, 4000), {0, 0, 1}});
  const uint64_t before = HashMap(replica_.map());
  replica_.AddDelta(wrong);
  EXPECT_THAT(replica_.ApplyPending(), IsEmpty());
  EXPECT_TRUE(replica_.NeedsSnapshot());
  EXPECT_THAT(replica_.last_problem(), HasSubstr("fewer than two"));
  EXPECT_EQ(HashMap(replica_.map()), before);
  GiveData();
  replica_.AddDelta(owner_.Snapshot());
  EXPECT_EQ(replica_.ApplyPending().size(), 1u);
  ExpectInStep();
}

TEST_F(ReplicaTest, QueueIsBounded) {
  const std::vector<MapDelta> deltas = MakeDeltas(300);
  for (const MapDelta& delta : deltas) replica_.AddDelta(delta);
  EXPECT_EQ(replica_.waiting(), 256u);
  EXPECT_EQ(replica_.counters().overflow, 44u);
  EXPECT_TRUE(replica_.NeedsSnapshot());
  GiveData();
  replica_.AddDelta(owner_.Snapshot());
  static_cast<void>(replica_.ApplyPending());
  ExpectInStep();
}

TEST_F(ReplicaTest, DeltaOfAnotherMapIsRejected) {
  MapDelta other = MakeDeltas(1)[0];
  other.map = MapId(0, 1, 2);
  replica_.AddDelta(other);
  EXPECT_EQ(replica_.counters().rejected, 1u);
  EXPECT_EQ(replica_.waiting(), 0u);
}

TEST_F(ReplicaTest, GivesUpADeltaThatWholeStatesAreNoHelpTo) {
  GiveAll(MakeDeltas(2));
  MapDelta ahead = MakeDeltas(1)[0];
  ahead.base_revision += 1000;  // of nobody who owns the map
  ahead.revision += 1000;
  replica_.AddDelta(ahead);
  static_cast<void>(replica_.ApplyPending());
  for (int i = 0; i < 4; ++i) {
    EXPECT_TRUE(replica_.NeedsSnapshot());
    GiveAll({owner_.Snapshot()});
  }
  ExpectInStep();
  EXPECT_EQ(replica_.counters().rejected, 1u);
  GiveAll(MakeDeltas(3));
  ExpectInStep();
}

TEST_F(ReplicaTest, WhatFollowsASnapshotThatCameLateIsKept) {
  const std::vector<MapDelta> before = MakeDeltas(2);
  const MapDelta snapshot = owner_.Snapshot();
  const std::vector<MapDelta> after = MakeDeltas(5);
  GiveData();
  for (const MapDelta& delta : after) replica_.AddDelta(delta);
  static_cast<void>(replica_.ApplyPending());
  EXPECT_EQ(replica_.waiting(), after.size());
  replica_.AddDelta(snapshot);
  EXPECT_EQ(replica_.ApplyPending().size(), 1 + after.size());
  ExpectInStep();
}

TEST_F(ReplicaTest, DropsOnlyDataThatIsNotInTheMap) {
  GiveAll(MakeDeltas(2));
  const KeyFrameId in_map = replica_.map().keyframes().begin()->first;
  Random random(1);
  const auto extra = RandomEdits::MakeData(KeyFrameId(0, 1, 900), &random);
  replica_.AddKeyFrameData(extra);
  replica_.DropKeyFrameData(extra->id);
  replica_.DropKeyFrameData(in_map);
  EXPECT_EQ(replica_.FindKeyFrameData(extra->id), nullptr);
  EXPECT_NE(replica_.FindKeyFrameData(in_map), nullptr);
}

TEST_F(ReplicaTest, FollowsWithoutTheAppearanceOfItsKeyFrames) {
  GiveAll(MakeDeltas(20));
  const Map whole = replica_.map();
  for (const auto& [id, data] : edits_.data()) replica_.DropAppearance(id);
  replica_.DropAppearance(KeyFrameId(0, 1, 0xfffff0));  // unknown
  for (const auto& [id, point] : replica_.map().points()) EXPECT_EQ(point.descriptor, whole.point(id).descriptor);
  GiveAll(MakeDeltas(20));
  ExpectInStep();
  EXPECT_THAT(ValidateMap(replica_.map()), IsEmpty());
  size_t bare = 0;
  for (const auto& [id, keyframe] : replica_.map().keyframes()) {
    const bool is_bare = whole.FindKeyFrame(id) != nullptr;
    EXPECT_EQ(keyframe.data->features.HasAppearance(), !is_bare);
    EXPECT_EQ(keyframe.data, replica_.FindKeyFrameData(id));
    bare += is_bare;
  }
  EXPECT_GT(bare, 0u);
  EXPECT_LT(bare, replica_.map().keyframes().size());
}

TEST_F(ReplicaTest, TakesASnapshotOfKeyFramesWithoutAppearance) {
  GiveAll(MakeDeltas(20));
  for (const auto& [id, data] : edits_.data()) replica_.DropAppearance(id);
  owner_.SetEpoch(3);
  replica_.AddDelta(owner_.Snapshot());
  EXPECT_EQ(replica_.ApplyPending().size(), 1u);
  ExpectInStep();
}

}  // namespace
}  // namespace portolan
