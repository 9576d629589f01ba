#include "mapping/fused_maps.h"

#include <gtest/gtest.h>

#include "map/random_edits.h"

namespace portolan {
namespace {

constexpr double kTolerance = 1e-9;

class FusedMapsTest : public ::testing::Test {
 protected:
  FusedMapsTest() {
    for (int i = 0; i < 5; ++i) edits_.Edit(RandomEdits::kAddKeyFrame);
    message_.map = b_.id();
    message_.reference = b_.keyframes().begin()->first;
    message_.camera_from_map = edits_.SomePose();
    message_.landmarks = {{3, MapPointId(0, 1, 5)}};
  }
  /// All of b, moved, is in a.
  void TakeIn(const Sim3d& a_from_b) {
    for (const auto& [id, keyframe] : b_.keyframes())
      a_.AddKeyFrame(keyframe.data, TransformPose(keyframe.camera_from_map, a_from_b), KeyFrameId());
  }
  bool Redirect(KeyFrameMessage* message) const {
    return fused_.Redirect([&](MapId map) { return map == a_.id() ? &a_ : nullptr; }, message);
  }
  static void ExpectPose(const Rigid3d& pose, const Rigid3d& expected) {
    EXPECT_LT(LogSE3(pose * expected.Inverse()).norm(), kTolerance);
  }

  Map a_{MapId(0, 1, 1)}, b_{MapId(0, 1, 2)};
  RandomEdits edits_{3, &b_};
  const Sim3d a_from_b_{1.7, ExpSO3({0.3, -0.2, 0.5}), {4, 5, 6}};
  KeyFrameMessage message_;
  FusedMaps fused_;
};

TEST_F(FusedMapsTest, AKeyFrameFollowsIntoTheMapThatHasItsMap) {
  TakeIn(a_from_b_);
  fused_.Note(b_, a_.id(), a_from_b_);
  KeyFrameMessage redirected = message_;
  ASSERT_TRUE(Redirect(&redirected));
  EXPECT_EQ(redirected.map, a_.id());
  EXPECT_EQ(redirected.reference, message_.reference);
  EXPECT_EQ(redirected.landmarks, message_.landmarks);
  ExpectPose(redirected.camera_from_map, TransformPose(message_.camera_from_map, a_from_b_));
}

TEST_F(FusedMapsTest, ItKeepsItsRelationToAReferenceThatMovedSince) {
  TakeIn(a_from_b_);
  fused_.Note(b_, a_.id(), a_from_b_);
  const Rigid3d reference_then = b_.keyframe(message_.reference).camera_from_map, reference_now = edits_.SomePose();
  a_.SetPose(message_.reference, reference_now);
  KeyFrameMessage redirected = message_;
  ASSERT_TRUE(Redirect(&redirected));
  Rigid3d own_from_reference = message_.camera_from_map * reference_then.Inverse();
  own_from_reference.translation *= a_from_b_.scale;
  ExpectPose(redirected.camera_from_map, own_from_reference * reference_now);
}

TEST_F(FusedMapsTest, AnUnknownReferenceFollowsTheWholeMap) {
  fused_.Note(b_, a_.id(), a_from_b_);
  message_.reference = KeyFrameId(8, 8, 8);
  KeyFrameMessage redirected = message_;
  ASSERT_TRUE(Redirect(&redirected));
  ExpectPose(redirected.camera_from_map, TransformPose(message_.camera_from_map, a_from_b_));
}

TEST_F(FusedMapsTest, FollowsFusionsOneAfterAnother) {
  const Sim3d b_from_c(0.4, ExpSO3({0, 0.7, 0}), {1, 0, 2});
  Map c(MapId(0, 1, 3));
  fused_.Note(c, b_.id(), b_from_c);
  fused_.Note(b_, a_.id(), a_from_b_);
  message_.map = c.id();
  KeyFrameMessage redirected = message_;
  ASSERT_TRUE(Redirect(&redirected));
  EXPECT_EQ(redirected.map, a_.id());
  ExpectPose(redirected.camera_from_map, TransformPose(message_.camera_from_map, a_from_b_ * b_from_c));
}

TEST_F(FusedMapsTest, OtherKeyFramesAreLeftAlone) {
  fused_.Note(b_, a_.id(), a_from_b_);
  KeyFrameMessage other = message_;
  other.map = a_.id();
  EXPECT_FALSE(Redirect(&other));
  EXPECT_EQ(other.map, a_.id());
  other = message_;
  other.kind = KeyFrameKind::kInitialSecond;  // a pair belongs to the map that it begins
  EXPECT_FALSE(Redirect(&other));
  EXPECT_EQ(other.map, b_.id());
}

TEST_F(FusedMapsTest, RemembersTheLastOnes) {
  for (uint32_t i = 1; i <= 20; ++i) fused_.Note(Map(MapId(0, 2, i)), a_.id(), a_from_b_);
  message_.map = MapId(0, 2, 20);
  EXPECT_TRUE(Redirect(&message_));
  message_.map = MapId(0, 2, 1);
  EXPECT_FALSE(Redirect(&message_));
}

}  // namespace
}  // namespace portolan
