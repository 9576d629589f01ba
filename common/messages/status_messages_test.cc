#include "messages/status_messages.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>

#include "messages/limits.h"
#include "messages/malformed_messages.h"
#include "messages/random_messages.h"

namespace portolan {
namespace {

using testing::ElementsAre;
using testing::Pair;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

TEST(StatusMessagesTest, TrackerStatesComeBack) {
  Random random(1);
  for (int i = 0; i < 20; ++i) {
    const TrackerState sent = RandomTrackerState(&random);
    const Result<TrackerState> received = FromWire(ToWire(sent));
    ASSERT_TRUE(received.ok()) << received.error().message;
    EXPECT_EQ(received->process, sent.process);
    EXPECT_EQ(received->frame, sent.frame);
    EXPECT_EQ(received->stamp, sent.stamp);
    EXPECT_EQ(received->state, sent.state);
    EXPECT_EQ(received->map, sent.map);
    EXPECT_EQ(received->camera_from_map.rotation.coeffs(), sent.camera_from_map.rotation.coeffs());
    EXPECT_EQ(received->camera_from_map.translation, sent.camera_from_map.translation);
    EXPECT_EQ(received->quality, sent.quality);
    EXPECT_EQ(received->num_inliers, sent.num_inliers);
    EXPECT_EQ(received->num_candidates, sent.num_candidates);
    EXPECT_EQ(received->frame_ms, sent.frame_ms);
    EXPECT_EQ(received->interrupt_mapper, sent.interrupt_mapper);
  }
}

TEST(StatusMessagesTest, MapperStatesComeBack) {
  Random random(2);
  const MapperState sent = RandomMapperState(&random);
  const Result<MapperState> received = FromWire(ToWire(sent));
  ASSERT_TRUE(received.ok());
  EXPECT_EQ(received->process, sent.process);
  EXPECT_EQ(received->map, sent.map);
  EXPECT_EQ(received->epoch, sent.epoch);
  EXPECT_EQ(received->revision, sent.revision);
  EXPECT_EQ(received->idle, sent.idle);
  EXPECT_EQ(received->queue_depth, sent.queue_depth);
  EXPECT_EQ(received->last_keyframe, sent.last_keyframe);
  EXPECT_EQ(received->refused_keyframe, sent.refused_keyframe);
  EXPECT_EQ(received->refusal, sent.refusal);
  EXPECT_EQ(received->is_refining, sent.is_refining);
  EXPECT_EQ(received->correction_process, sent.correction_process);
  EXPECT_EQ(received->correction_number, sent.correction_number);
  EXPECT_EQ(received->correction_refusal, sent.correction_refusal);
}

TEST(StatusMessagesTest, FollowerStatesComeBack) {
  Random random(7);
  const FollowerState sent = RandomFollowerState(&random);
  const Result<FollowerState> received = FromWire(ToWire(sent));
  ASSERT_TRUE(received.ok());
  EXPECT_EQ(received->process, sent.process);
  EXPECT_EQ(received->map, sent.map);
  EXPECT_EQ(received->epoch, sent.epoch);
  EXPECT_EQ(received->last_keyframe, sent.last_keyframe);
  EXPECT_EQ(received->is_busy, sent.is_busy);
  EXPECT_EQ(received->revision, sent.revision);
}

TEST(StatusMessagesTest, ProcessStatusesComeBack) {
  Random random(3);
  const ProcessStatus sent = RandomProcessStatus(&random);
  const Result<ProcessStatus> received = FromWire(ToWire(sent));
  ASSERT_TRUE(received.ok());
  EXPECT_EQ(received->process, sent.process);
  EXPECT_EQ(received->role, sent.role);
  EXPECT_EQ(received->host, sent.host);
  EXPECT_EQ(received->pid, sent.pid);
  EXPECT_EQ(received->vendor, sent.vendor);
  EXPECT_EQ(received->build, sent.build);
  EXPECT_EQ(received->priority, sent.priority);
  EXPECT_EQ(received->state, sent.state);
  EXPECT_EQ(received->map, sent.map);
  EXPECT_EQ(received->epoch, sent.epoch);
  EXPECT_EQ(received->revision, sent.revision);
  EXPECT_EQ(received->figures, sent.figures);
}

TEST(StatusMessagesTest, FiguresThatSayNothingAreLeftOut) {
  Random random(4);
  ProcessStatus sent = RandomProcessStatus(&random);
  sent.figures = {{"mean of none", kNaN}, {"queue", 2.0}};
  const Result<ProcessStatus> received = FromWire(ToWire(sent));
  ASSERT_TRUE(received.ok());
  EXPECT_THAT(received->figures, ElementsAre(Pair("queue", 2.0)));
}

TEST(StatusMessagesTest, RefusesWhatIsMalformedAndSaysWhy) {
  Random random(5);
  ExpectRefused<wire::TrackerState>(
      ToWire(RandomTrackerState(&random)),
      {
          {"process is none", [](wire::TrackerState* w) { w->process(0); }},
          {"state is 4", [](wire::TrackerState* w) { w->state(4); }},
          {"quaternion", [](wire::TrackerState* w) { w->camera_from_map().rotation()[2] += 3; }},
          {"quality", [](wire::TrackerState* w) { w->quality(NAN); }},
          {"frame_ms", [](wire::TrackerState* w) { w->frame_ms(NAN); }},
      });
  ExpectRefused<wire::FollowerState>(ToWire(RandomFollowerState(&random)),
                                     {{"process is none", [](wire::FollowerState* w) { w->process(0); }},
                                      {"epoch is", [](wire::FollowerState* w) { w->epoch(kMaxEpoch + 1); }},
                                      {"revision is", [](wire::FollowerState* w) { w->revision(kMaxRevision + 1); }}});
  ExpectRefused<wire::MapperState>(
      ToWire(RandomMapperState(&random)),
      {
          {"process is none", [](wire::MapperState* w) { w->process(0); }},
          {"epoch is", [](wire::MapperState* w) { w->epoch(kMaxEpoch + 1); }},
          {"revision is", [](wire::MapperState* w) { w->revision(kMaxRevision + 1); }},
          {"refusal holds", [](wire::MapperState* w) { w->refusal("\x1b[2J"); }},
          {"correction_refusal holds", [](wire::MapperState* w) { w->correction_refusal("\x1b[2J"); }},
      });
  ExpectRefused<wire::ProcessStatus>(
      ToWire(RandomProcessStatus(&random)),
      {
          {"process is none", [](wire::ProcessStatus* w) { w->process(0); }},
          {"epoch is", [](wire::ProcessStatus* w) { w->epoch(kMaxEpoch + 1); }},
          {"revision is", [](wire::ProcessStatus* w) { w->revision(kMaxRevision + 1); }},
          {"role is empty", [](wire::ProcessStatus* w) { w->role(""); }},
          {"host holds", [](wire::ProcessStatus* w) { w->host("\x01"); }},
          {"length of state", [](wire::ProcessStatus* w) { w->state(std::string(kMaxLineBytes + 1, 'x')); }},
          {"figure_values has", [](wire::ProcessStatus* w) { w->figure_values().pop_back(); }},
          {"figure_values holds", [](wire::ProcessStatus* w) { w->figure_values()[0] = kNaN; }},
          {"figure_names is empty", [](wire::ProcessStatus* w) { w->figure_names()[0] = ""; }},
          {"number of figures", [](wire::ProcessStatus* w) { w->figure_names().assign(kMaxFigures + 1, "x"); }},
      });
}

}  // namespace
}  // namespace portolan
