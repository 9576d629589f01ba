#include "messages/correction_messages.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>

#include "messages/limits.h"
#include "messages/malformed_messages.h"
#include "messages/random_messages.h"

namespace portolan {
namespace {

TEST(CorrectionMessagesTest, ACorrectionComesBackToTheBit) {
  Random random(1);
  const MapCorrection sent = RandomCorrection(&random);
  const Result<MapCorrection> received = FromWire(ToWire(sent));
  ASSERT_TRUE(received.ok()) << received.error().message;
  EXPECT_EQ(received->process, sent.process);
  EXPECT_EQ(received->number, sent.number);
  EXPECT_EQ(received->map, sent.map);
  EXPECT_EQ(received->epoch, sent.epoch);
  EXPECT_EQ(received->made_from_revision, sent.made_from_revision);
  EXPECT_EQ(received->kind, sent.kind);
  EXPECT_EQ(received->other, sent.other);
  EXPECT_EQ(received->map_from_other.translation, sent.map_from_other.translation);
  EXPECT_EQ(received->map_from_other.scale, sent.map_from_other.scale);
  ASSERT_EQ(received->keyframes.size(), sent.keyframes.size());
  for (size_t i = 0; i < sent.keyframes.size(); ++i) {
    EXPECT_EQ(received->keyframes[i].id, sent.keyframes[i].id);
    EXPECT_EQ(received->keyframes[i].camera_from_map.scale, sent.keyframes[i].camera_from_map.scale);
    EXPECT_EQ(received->keyframes[i].camera_from_map.rotation.coeffs(),
              sent.keyframes[i].camera_from_map.rotation.coeffs());
    EXPECT_EQ(received->keyframes[i].camera_from_map.translation, sent.keyframes[i].camera_from_map.translation);
  }
  ASSERT_EQ(received->points.size(), sent.points.size());
  for (size_t i = 0; i < sent.points.size(); ++i) {
    EXPECT_EQ(received->points[i].id, sent.points[i].id);
    EXPECT_EQ(received->points[i].position_in_map, sent.points[i].position_in_map);
  }
  EXPECT_EQ(received->merges, sent.merges);
  EXPECT_EQ(received->observations, sent.observations);
  EXPECT_EQ(received->loop_edges, sent.loop_edges);
}

TEST(CorrectionMessagesTest, RefusesWhatIsMalformedAndSaysWhy) {
  const std::vector<Malformed<wire::MapCorrection>> cases = {
      {"process is none", [](wire::MapCorrection* w) { w->process(0); }},
      {"map is none", [](wire::MapCorrection* w) { w->map_id(0); }},
      {"epoch is 281474976710657", [](wire::MapCorrection* w) { w->epoch(kMaxEpoch + 1); }},
      {"made_from_revision is", [](wire::MapCorrection* w) { w->made_from_revision(kMaxRevision + 1); }},
      {"other is none in kind fusion", [](wire::MapCorrection* w) { w->other(0); }},
      {"other is given in kind loop", [](wire::MapCorrection* w) { w->kind("loop"); }},
      {"fuses a map with itself", [](wire::MapCorrection* w) { w->other(w->map_id()); }},
      {"scale", [](wire::MapCorrection* w) { w->map_from_other().scale(-1); }},
      {"kind is empty", [](wire::MapCorrection* w) { w->kind(""); }},
      {"kind holds control characters", [](wire::MapCorrection* w) { w->kind("lo\x1bop"); }},
      {"length of kind", [](wire::MapCorrection* w) { w->kind(std::string(1000, 'x')); }},
      {"keyframes holds", [](wire::MapCorrection* w) { w->keyframes()[0] = 0; }},
      {"keyframe_poses has", [](wire::MapCorrection* w) { w->keyframe_poses().pop_back(); }},
      {"scale -1", [](wire::MapCorrection* w) { w->keyframe_poses()[8] = -1; }},
      {"scale 0", [](wire::MapCorrection* w) { w->keyframe_poses()[0] = 0; }},
      {"quaternion", [](wire::MapCorrection* w) { w->keyframe_poses()[9] += 5; }},
      {"not finite", [](wire::MapCorrection* w) { w->keyframe_poses()[15] = std::numeric_limits<double>::infinity(); }},
      {"points holds", [](wire::MapCorrection* w) { w->points()[0] = 0; }},
      {"point_positions has", [](wire::MapCorrection* w) { w->point_positions().push_back(0); }},
      {"point_positions holds", [](wire::MapCorrection* w) { w->point_positions()[0] = NAN; }},
      {"merges has", [](wire::MapCorrection* w) { w->merges_into().clear(); }},
      {"merges holds", [](wire::MapCorrection* w) { w->merges_into()[0] = 0; }},
      {"merges pairs an element with itself", [](wire::MapCorrection* w) { w->merges_into() = w->merges_from(); }},
      {"seen_by has", [](wire::MapCorrection* w) { w->seen_by().pop_back(); }},
      {"seen_features has", [](wire::MapCorrection* w) { w->seen_features().clear(); }},
      {"seen_points holds", [](wire::MapCorrection* w) { w->seen_points()[0] = 0; }},
      {"seen_by holds", [](wire::MapCorrection* w) { w->seen_by()[0] = 0; }},
      {"seen_features holds 4000000000", [](wire::MapCorrection* w) { w->seen_features()[0] = 4000000000u; }},
      {"loop_edges pairs", [](wire::MapCorrection* w) { w->loop_edges_a() = w->loop_edges_b(); }},
  };
  Random random(2);
  const wire::MapCorrection good = ToWire(RandomCorrection(&random));
  ExpectRefused(good, cases);
}

}  // namespace
}  // namespace portolan
