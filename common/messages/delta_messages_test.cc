#include "messages/delta_messages.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>

#include "messages/limits.h"
#include "messages/malformed_messages.h"
#include "messages/random_messages.h"

namespace portolan {
namespace {

using testing::HasSubstr;

void ExpectSamePose(const Rigid3d& a, const Rigid3d& b) {
  EXPECT_EQ(a.rotation.coeffs(), b.rotation.coeffs());
  EXPECT_EQ(a.translation, b.translation);
}

void ExpectSameElements(const MapDelta& a, const MapDelta& b) {
  EXPECT_EQ(a.residuals, b.residuals);
  ASSERT_EQ(a.removed_points.size(), b.removed_points.size());
  for (size_t i = 0; i < a.removed_points.size(); ++i) {
    EXPECT_EQ(a.removed_points[i].id, b.removed_points[i].id);
    EXPECT_EQ(a.removed_points[i].replaced_by, b.removed_points[i].replaced_by);
  }
  ASSERT_EQ(a.removed_keyframes.size(), b.removed_keyframes.size());
  for (size_t i = 0; i < a.removed_keyframes.size(); ++i) {
    EXPECT_EQ(a.removed_keyframes[i].id, b.removed_keyframes[i].id);
    EXPECT_EQ(a.removed_keyframes[i].anchor, b.removed_keyframes[i].anchor);
    ExpectSamePose(a.removed_keyframes[i].removed_from_anchor, b.removed_keyframes[i].removed_from_anchor);
  }
  ASSERT_EQ(a.keyframes.size(), b.keyframes.size());
  for (size_t i = 0; i < a.keyframes.size(); ++i) {
    EXPECT_EQ(a.keyframes[i].id, b.keyframes[i].id);
    EXPECT_EQ(a.keyframes[i].parent, b.keyframes[i].parent);
    EXPECT_EQ(a.keyframes[i].num_features, b.keyframes[i].num_features);
    ExpectSamePose(a.keyframes[i].camera_from_map, b.keyframes[i].camera_from_map);
  }
  ASSERT_EQ(a.points.size(), b.points.size());
  for (size_t i = 0; i < a.points.size(); ++i) {
    EXPECT_EQ(a.points[i].id, b.points[i].id);
    EXPECT_EQ(a.points[i].position_in_map, b.points[i].position_in_map);
  }
  ASSERT_EQ(a.observations.size(), b.observations.size());
  for (size_t i = 0; i < a.observations.size(); ++i) {
    EXPECT_EQ(a.observations[i].point, b.observations[i].point);
    EXPECT_EQ(a.observations[i].keyframe, b.observations[i].keyframe);
    EXPECT_EQ(a.observations[i].feature, b.observations[i].feature);
  }
}

TEST(DeltaMessagesTest, ADeltaComesBackToTheBit) {
  Random random(1);
  for (const size_t n : {size_t{0}, size_t{1}, size_t{1000}}) {
    const MapDeltaChunk sent = RandomDelta(n, &random);
    const Result<MapDeltaChunk> received = FromWire(ToWire(sent));
    ASSERT_TRUE(received.ok()) << received.error().message;
    EXPECT_EQ(received->index, sent.index);
    EXPECT_EQ(received->count, sent.count);
    EXPECT_EQ(received->part.map, sent.part.map);
    EXPECT_EQ(received->part.epoch, sent.part.epoch);
    EXPECT_EQ(received->part.base_revision, sent.part.base_revision);
    EXPECT_EQ(received->part.revision, sent.part.revision);
    ExpectSameElements(received->part, sent.part);
  }
}

TEST(DeltaMessagesTest, ObservationsInAnyOrderComeBackInIt) {
  MapDeltaChunk sent;
  sent.part.map = MapId(1, 2, 3);
  sent.part.revision = 1;
  for (uint32_t i = 0; i < 100; ++i) {  // points come back after others
    sent.part.observations.push_back(
        {MapPointId(1, 2, 1 + i % 7), KeyFrameId(1, 2, 1 + i % 3), i % 5 == 0 ? -1 : static_cast<int32_t>(i)});
  }
  const Result<MapDeltaChunk> received = FromWire(ToWire(sent));
  ASSERT_TRUE(received.ok()) << received.error().message;
  ExpectSameElements(received->part, sent.part);
}

TEST(DeltaMessagesTest, TheLargestChunkHasAKeyFrameForEachObservation) {
  MapDeltaChunk sent;
  sent.part.map = MapId(1, 2, 3);
  sent.part.revision = 1;
  for (uint32_t i = 0; i < kMaxChunkElements; ++i)
    sent.part.observations.push_back({MapPointId(1, 2, 1), KeyFrameId(1, 2, 1 + i), 0});
  const Result<MapDeltaChunk> received = FromWire(ToWire(sent));
  ASSERT_TRUE(received.ok()) << received.error().message;
  ExpectSameElements(received->part, sent.part);
  sent.part.observations.push_back({MapPointId(1, 2, 1), KeyFrameId(1, 2, 1), 1});
  EXPECT_THROW(ToWire(sent), CheckFailure);
}

TEST(DeltaMessagesTest, RefusesWhatIsMalformedAndSaysWhy) {
  constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
  const std::vector<Malformed<wire::MapDelta>> cases = {
      {"map is none", [](wire::MapDelta* w) { w->map_id(0); }},
      {"epoch is 281474976710657", [](wire::MapDelta* w) { w->epoch(kMaxEpoch + 1); }},
      {"revision is 281474976710657", [](wire::MapDelta* w) { w->revision(kMaxRevision + 1); }},
      {"chunk 5 of 5", [](wire::MapDelta* w) { w->chunk_index(5), w->chunk_count(5); }},
      {"chunk_count is 4000000000", [](wire::MapDelta* w) { w->chunk_count(4000000000u); }},
      {"does not follow its base", [](wire::MapDelta* w) { w->base_revision(7), w->revision(7); }},
      {"residual.k1 is", [](wire::MapDelta* w) { w->residuals()[0].residual().k1(-2); }},
      {"camera.fx is not positive", [](wire::MapDelta* w) { w->residuals()[0].camera().fx(0); }},
      {"number of residuals", [](wire::MapDelta* w) { w->residuals().resize(kMaxResiduals + 1); }},
      {"removed_replaced_by has", [](wire::MapDelta* w) { w->removed_replaced_by().pop_back(); }},
      {"removed_points holds", [](wire::MapDelta* w) { w->removed_points()[0] = 0; }},
      {"removed_anchors has", [](wire::MapDelta* w) { w->removed_anchors().clear(); }},
      {"removed_from_anchor has", [](wire::MapDelta* w) { w->removed_from_anchor().pop_back(); }},
      {"removed_from_anchor: quaternion", [](wire::MapDelta* w) { w->removed_from_anchor()[0] += 3; }},
      {"removed_keyframes holds", [](wire::MapDelta* w) { w->removed_keyframes()[0] = 0; }},
      {"keyframes holds", [](wire::MapDelta* w) { w->keyframes()[0] = 0; }},
      {"keyframe_parents has", [](wire::MapDelta* w) { w->keyframe_parents().clear(); }},
      {"keyframe_num_features has", [](wire::MapDelta* w) { w->keyframe_num_features().clear(); }},
      {"keyframe_num_features is 20001", [](wire::MapDelta* w) { w->keyframe_num_features()[0] = 20001; }},
      {"keyframe_poses has", [](wire::MapDelta* w) { w->keyframe_poses().pop_back(); }},
      {"keyframe_poses holds a value that is not finite", [=](wire::MapDelta* w) { w->keyframe_poses()[5] = kNaN; }},
      {"points holds", [](wire::MapDelta* w) { w->points()[3] = 0; }},
      {"point_positions has", [](wire::MapDelta* w) { w->point_positions().pop_back(); }},
      {"point_positions holds",
       [](wire::MapDelta* w) { w->point_positions()[2] = std::numeric_limits<float>::infinity(); }},
      {"observation_keyframes has", [](wire::MapDelta* w) { w->observation_keyframes().pop_back(); }},
      {"run_lengths has", [](wire::MapDelta* w) { w->run_lengths().pop_back(); }},
      {"a run of observations is empty", [](wire::MapDelta* w) { w->run_lengths()[0] = 0; }},
      {"observations in runs has", [](wire::MapDelta* w) { w->run_lengths()[0] = 9; }},
      {"run_points holds", [](wire::MapDelta* w) { w->run_points()[0] = 0; }},
      {"observing_keyframes holds", [](wire::MapDelta* w) { w->observing_keyframes()[0] = 0; }},
      {"not in the table", [](wire::MapDelta* w) { w->observation_keyframes()[1] = 60000; }},
      {"number of observing keyframes", [](wire::MapDelta* w) { w->observing_keyframes().resize(10000, 1); }},
      {"observation's feature is out of range", [](wire::MapDelta* w) { w->observation_features()[1] = 20000; }},
      {"number of elements is", [](wire::MapDelta* w) { w->points().resize(70000, 1); }},
  };
  Random random(2);
  const wire::MapDelta good = ToWire(RandomDelta(10, &random));
  ExpectRefused(good, cases);
}

TEST(SnapshotRequestMessagesTest, ComesBackOrIsRefused) {
  Random random(3);
  const SnapshotRequest sent = RandomSnapshotRequest(&random);
  const wire::SnapshotRequest good = ToWire(sent);
  const Result<SnapshotRequest> received = FromWire(good);
  ASSERT_TRUE(received.ok());
  EXPECT_EQ(received->map, sent.map);
  EXPECT_EQ(received->have_revision, sent.have_revision);
  EXPECT_EQ(received->have_keyframes, sent.have_keyframes);
  EXPECT_EQ(received->asker, sent.asker);

  wire::SnapshotRequest spoilt = good;
  spoilt.map_id(0);
  EXPECT_THAT(FromWire(spoilt).error().message, HasSubstr("map is none"));
  spoilt = good;
  spoilt.asker(0);
  EXPECT_THAT(FromWire(spoilt).error().message, HasSubstr("asker is none"));
  spoilt = good;
  spoilt.have_keyframes()[2] = 0;
  EXPECT_THAT(FromWire(spoilt).error().message, HasSubstr("have_keyframes"));
  spoilt.have_keyframes().assign(kMaxListedKeyFrames + 1, 1);
  EXPECT_THAT(FromWire(spoilt).error().message, HasSubstr("number of keyframes"));
}

}  // namespace
}  // namespace portolan
