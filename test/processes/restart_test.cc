// A process dies without a word, another comes in its place, and the run goes on.

#include <filesystem>

#include "processes/deployment.h"
#include "processes/run_output_check.h"

namespace portolan {
namespace {

class RestartTest : public DeploymentTest {};

class MapperRestartTest : public RestartTest, public ::testing::WithParamInterface<const char*> {};

TEST_P(MapperRestartTest, NewMapperGoesOnWithTheMapInTheNextEpoch) {
  StartAll({"--data", Sequence(), "--speed", RealTimeSpeed(0.5), "--dds", GetParam()});
  WaitUntilMapping();
  const ProcessStatus first = *watch().heard().Of("backend_mapper");
  Kill("backend_mapper");
  StartRole("backend_mapper", {"--dds", GetParam()});
  EXPECT_TRUE(watch().WaitUntil(
      [&](const StatusWatch::Heard& heard) {
        const ProcessStatus* mapper = heard.Of("backend_mapper");
        return mapper->process != first.process && mapper->map == first.map && mapper->epoch > first.epoch &&
               mapper->revision > first.revision;
      },
      kProcessDeadline))
      << Logs();
  ExpectGoodEnd();
  EXPECT_EQ(Report("atlas_server")["takeovers"], 1);
}

INSTANTIATE_TEST_SUITE_P(Vendors, MapperRestartTest, ::testing::Values("fastdds", "cyclonedds"),
                         [](const auto& parameter) { return std::string(parameter.param); });

TEST_F(RestartTest, LockstepWaitsForTheNewMapper) {
  StartAll({"--data", Sequence(), "--speed", "lockstep", "--set", "source.peer_timeout_s=120"});
  ASSERT_TRUE(
      watch().WaitUntil([](const StatusWatch::Heard& heard) { return heard.TrackerIsAt(40); }, kProcessDeadline))
      << Logs();
  Kill("backend_mapper");
  StartRole("backend_mapper");
  ExpectGoodEnd();
  EXPECT_GT(Report("backend_mapper")["keyframes_taken"], 0) << "the first left no report";
}

TEST_F(RestartTest, NewLoopCloserCatchesUp) {
  StartAll({"--data", Sequence(), "--speed", RealTimeSpeed(0.5)});
  WaitUntilMapping();
  Kill("loop_closer");
  StartRole("loop_closer");
  ExpectGoodEnd();
}

/// As a camera would: the clock goes on while nobody tracks. What the first one tracked is in the trajectory.
TEST_F(RestartTest, ResumedFrontendGoesOnWhereTheClockIsAndKeepsWhatWasTracked) {
  const std::vector<std::string> arguments = {"--data", Sequence(), "--speed", RealTimeSpeed(0.3), "--resume"};
  StartAll(arguments);
  WaitUntilMapping();
  const uint64_t killed_at = watch().heard().tracker->frame;
  const ProcessId first = watch().heard().Of("frontend_tracker")->process;
  Kill("frontend_tracker");
  StartRole("frontend_tracker", arguments);
  EXPECT_TRUE(watch().WaitUntil(
      [&](const StatusWatch::Heard& heard) {
        return heard.tracker->process != first && heard.tracker->state == TrackingState::kTracking;
      },
      kProcessDeadline))
      << Logs();
  EXPECT_GT(watch().heard().tracker->frame, killed_at);
  ExpectGoodEnd(0.4);
  const nlohmann::json report = Report("frontend_tracker");
  EXPECT_EQ(report["frames"], NumFrames());
  EXPECT_GT(report["tracked"], report["tracked_online"]) << "frames of the first are among them";
  EXPECT_FALSE(std::filesystem::exists(Out() + "/frames_journal.txt"));
}

TEST_F(RestartTest, ResumedFrontendWithoutARunToGoOnWithBeginsOne) {
  StartAll({"--data", Sequence(), "--speed", "max", "--resume"});
  ExpectGoodEnd();
}

/// The atlas_server finds its first frames in the map that the first one left.
TEST_F(RestartTest, NewFrontendGoesOnInTheMapThatIsThere) {
  StartAll({"--data", Sequence(), "--speed", RealTimeSpeed(0.5)});
  WaitUntilMapping();
  Kill("frontend_tracker");
  StartRole("frontend_tracker", {"--data", Sequence(), "--speed", RealTimeSpeed(0.5)});
  ExpectGoodEnd();
  EXPECT_EQ(Report("atlas_server")["maps"], 1);
  EXPECT_GE(Report("atlas_server")["overlaps"]["located"], 1);
}

TEST_F(RestartTest, NewAtlasServerTakesUpTheMapFromItsStoreAndFollowsIt) {
  StartAll({"--data", Sequence(), "--speed", RealTimeSpeed(0.5)});
  WaitUntilMapping();
  const ProcessStatus first = *watch().heard().Of("atlas_server");
  const ProcessStatus mapper = *watch().heard().Of("backend_mapper");
  Kill("atlas_server");
  StartRole("atlas_server");
  EXPECT_TRUE(watch().WaitUntil(
      [&](const StatusWatch::Heard& heard) {
        const ProcessStatus* atlas = heard.Of("atlas_server");
        return atlas->process != first.process && atlas->map == mapper.map && atlas->revision >= mapper.revision;
      },
      kProcessDeadline))
      << Logs();
  ExpectGoodEnd();
  const ProcessStatus last = *watch().heard().Of("backend_mapper");
  EXPECT_EQ(last.process, mapper.process);
  EXPECT_EQ(last.epoch, mapper.epoch) << "nobody took the map from its owner";
}

}  // namespace
}  // namespace portolan
