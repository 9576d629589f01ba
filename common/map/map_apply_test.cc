// Deltas: the owner's TakeDelta and Snapshot, the replica's Apply.

#include <gmock/gmock.h>

#include <algorithm>

#include "map/map.h"
#include "map/random_edits.h"

namespace portolan {
namespace {

using ::testing::IsEmpty;

constexpr Epoch kEpoch = 3;

class FollowingTest : public ::testing::TestWithParam<uint64_t> {
 protected:
  FollowingTest() : edits_(GetParam(), &owner_) {}

  MapDelta EditAndTake(int edits) {
    for (int i = 0; i < edits; ++i) edits_.Next();
    return owner_.TakeDelta();
  }

  Map owner_{MapId(0, 1, 1), kEpoch};
  RandomEdits edits_;
};

TEST_P(FollowingTest, ReplicaEqualsOwnerAfterEachDelta) {
  Map replica(owner_.id());
  for (int round = 0; round < 60; ++round) {
    const MapDelta delta = EditAndTake(1 + round % 12);
    if (delta.IsEmpty()) continue;
    const Status applied = replica.Apply(delta, edits_.FindData());
    ASSERT_TRUE(applied.ok()) << applied.error().message;
    ASSERT_EQ(HashMap(replica), HashMap(owner_)) << "round " << round;
    ASSERT_EQ(replica.revision(), owner_.revision());
    ASSERT_EQ(replica.epoch(), kEpoch);
    ASSERT_THAT(ValidateMap(replica), IsEmpty());
  }
  for (const auto& [a, keyframe] : owner_.keyframes())
    EXPECT_EQ(owner_.CovisibleKeyFrames(a, 1), replica.CovisibleKeyFrames(a, 1));
  for (const auto& [id, point] : owner_.points()) {
    EXPECT_EQ(point.descriptor, replica.point(id).descriptor);
    EXPECT_EQ(point.mean_viewing_direction, replica.point(id).mean_viewing_direction);
    EXPECT_EQ(point.max_distance, replica.point(id).max_distance);
  }
}

TEST_P(FollowingTest, ApplyingTheSameContentTwiceDoesNoHarm) {
  Map replica(owner_.id());
  for (int round = 0; round < 30; ++round) {
    MapDelta delta = EditAndTake(10);
    if (delta.IsEmpty()) continue;
    ASSERT_TRUE(replica.Apply(delta, edits_.FindData()).ok());
    delta.base_revision = delta.revision;
    const Revision revision = delta.revision++;
    const Status again = replica.Apply(delta, edits_.FindData());
    ASSERT_TRUE(again.ok()) << again.error().message;
    ASSERT_EQ(HashMap(replica), HashMap(owner_));
    // Back to the owner's count.
    MapDelta snapshot = owner_.Snapshot();
    snapshot.revision = revision;
    ASSERT_TRUE(replica.Apply(snapshot, edits_.FindData()).ok());
  }
}

TEST_P(FollowingTest, SnapshotEqualsTheSumOfDeltas) {
  static_cast<void>(EditAndTake(200));
  static_cast<void>(EditAndTake(100));
  Map replica(owner_.id());
  ASSERT_TRUE(replica.Apply(owner_.Snapshot(), edits_.FindData()).ok());
  EXPECT_EQ(HashMap(replica), HashMap(owner_));
  EXPECT_EQ(replica.revision(), owner_.revision());
  // And it goes on from there.
  const MapDelta next = EditAndTake(20);
  ASSERT_TRUE(replica.Apply(next, edits_.FindData()).ok());
  EXPECT_EQ(HashMap(replica), HashMap(owner_));
}

TEST_P(FollowingTest, SnapshotBetweenChangesAndTheirDeltaDoesNoHarm) {
  static_cast<void>(EditAndTake(100));
  for (int i = 0; i < 40; ++i) edits_.Next();
  Map replica(owner_.id());
  const Status snapshot = replica.Apply(owner_.Snapshot(), edits_.FindData());
  ASSERT_TRUE(snapshot.ok()) << snapshot.error().message;
  const Status delta = replica.Apply(EditAndTake(40), edits_.FindData());
  ASSERT_TRUE(delta.ok()) << delta.error().message;
  EXPECT_EQ(HashMap(replica), HashMap(owner_));
}

INSTANTIATE_TEST_SUITE_P(Seeds, FollowingTest, ::testing::Range<uint64_t>(1, 13));

class TakeDeltaTest : public ::testing::Test {
 protected:
  TakeDeltaTest() : edits_(5, &owner_) { static_cast<void>(owner_.TakeDelta()); }
  Map owner_{MapId(0, 1, 1), kEpoch};
  RandomEdits edits_;
};

TEST_F(TakeDeltaTest, NothingChangedIsEmptyAndKeepsTheRevision) {
  const Revision revision = owner_.revision();
  const MapDelta delta = owner_.TakeDelta();
  EXPECT_TRUE(delta.IsEmpty());
  EXPECT_EQ(delta.revision, revision);
  EXPECT_EQ(owner_.revision(), revision);
}

TEST_F(TakeDeltaTest, HoldsOnlyWhatChanged) {
  const MapPointId moved = edits_.SomePoint();
  owner_.SetPosition(moved, {1, 2, 3});
  const MapDelta delta = owner_.TakeDelta();
  EXPECT_EQ(delta.base_revision + 1, delta.revision);
  ASSERT_EQ(delta.points.size(), 1u);
  EXPECT_EQ(delta.points[0].id, moved);
  EXPECT_EQ(delta.points[0].position_in_map, Eigen::Vector3f(1, 2, 3));
  EXPECT_TRUE(delta.keyframes.empty() && delta.observations.empty() && delta.removed_points.empty());
}

TEST_F(TakeDeltaTest, WhatCameAndWentLeavesOnlyItsRemoval) {
  const MapPointId passing(0, 1, 999);
  owner_.AddPoint(passing, {0, 0, 4});
  owner_.AddObservation(passing, edits_.SomeKeyFrame(), 29);
  owner_.RemovePoint(passing);
  const MapDelta delta = owner_.TakeDelta();
  EXPECT_TRUE(delta.points.empty() && delta.observations.empty());
  ASSERT_EQ(delta.removed_points.size(), 1u);
}

TEST_F(TakeDeltaTest, PointsThatTooFewKeyFramesSeeAreNotPublished) {
  const MapPointId lonely(0, 1, 999), thinned = edits_.SomePoint();
  owner_.AddPoint(lonely, {0, 0, 4});
  while (owner_.point(thinned).observations.size() > 1)
    owner_.RemoveObservation(thinned, owner_.point(thinned).observations[0].keyframe);
  const MapDelta snapshot = owner_.Snapshot();
  EXPECT_TRUE(std::none_of(snapshot.points.begin(), snapshot.points.end(), [&](const MapDelta::PointState& state) {
    return state.id == lonely || state.id == thinned;
  }));
  static_cast<void>(owner_.TakeDelta());
  EXPECT_EQ(owner_.FindPoint(lonely), nullptr);
  EXPECT_EQ(owner_.FindPoint(thinned), nullptr);
  EXPECT_THAT(ValidateMap(owner_), IsEmpty());
}

/// A landmark passes its feature on to another within one delta.
TEST_F(TakeDeltaTest, FeaturesMayPassFromOneLandmarkToAnother) {
  Map replica(owner_.id());
  ASSERT_TRUE(replica.Apply(owner_.Snapshot(), edits_.FindData()).ok());
  const MapPointId giver = edits_.SomePoint();
  const std::vector<Observation> given = owner_.point(giver).observations;
  owner_.RemovePoint(giver);
  const MapPointId taker(0, 1, 999);
  owner_.AddPoint(taker, {0, 0, 4});
  for (const Observation& o : given) ASSERT_TRUE(owner_.AddObservation(taker, o.keyframe, o.feature));
  ASSERT_TRUE(replica.Apply(owner_.TakeDelta(), edits_.FindData()).ok());
  EXPECT_EQ(HashMap(replica), HashMap(owner_));
}

}  // namespace
}  // namespace portolan
