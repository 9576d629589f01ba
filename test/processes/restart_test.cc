// A process dies without a word, another comes in its place, and the run goes on.

#include <csignal>

#include "processes/deployment.h"
#include "processes/run_output_check.h"

namespace portolan {
namespace {

class RestartTest : public DeploymentTest {
 protected:
  void WaitUntilMapping() {
    ASSERT_TRUE(watch().WaitUntil(
        [](const StatusWatch::Heard& heard) {
          return heard.Figure("backend_mapper", "keyframes_taken") >= 3 &&
                 heard.Figure("atlas_server", "keyframes") >= 3;
        },
        kProcessDeadline))
        << Logs();
  }

  /// The frontend came to its end; the others are told to, and left what they should.
  void ExpectGoodEnd() {
    const Ended frontend = WaitForFrontend();
    ASSERT_EQ(frontend.code, 0) << frontend.output << Logs();
    for (const char* role : {"backend_mapper", "loop_closer", "atlas_server"})
      EXPECT_EQ(Interrupt(role).code, 0) << role;
    EXPECT_GT(ExpectTrajectory(Out() + "/trajectory.txt").size(), 0.8 * static_cast<double>(NumFrames()));
    ExpectAccurate(Truth(), Out() + "/trajectory.txt", 0.01);
    ExpectWholePly(Out() + "/map.ply");
    EXPECT_EQ(Report("frontend_tracker")["maps"], 1);
    ExpectSameMaps(Report("atlas_server"), Report("loop_closer"));
  }
};

class MapperRestartTest : public RestartTest, public ::testing::WithParamInterface<const char*> {};

TEST_P(MapperRestartTest, NewMapperGoesOnWithTheMapInTheNextEpoch) {
  StartAll({"--data", Sequence(), "--speed", "0.5", "--dds", GetParam()});
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
  StartAll({"--data", Sequence(), "--speed", "0.5"});
  WaitUntilMapping();
  Kill("loop_closer");
  StartRole("loop_closer");
  ExpectGoodEnd();
}

/// The atlas_server finds its first frames in the map that the first one left.
TEST_F(RestartTest, NewFrontendGoesOnInTheMapThatIsThere) {
  StartAll({"--data", Sequence(), "--speed", "0.5"});
  WaitUntilMapping();
  Kill("frontend_tracker");
  StartRole("frontend_tracker", {"--data", Sequence(), "--speed", "0.5"});
  ExpectGoodEnd();
  EXPECT_EQ(Report("atlas_server")["maps"], 1);
  EXPECT_GE(Report("atlas_server")["overlaps"]["located"], 1);
}

TEST_F(RestartTest, NewAtlasServerTakesUpTheMapFromItsStoreAndFollowsIt) {
  StartAll({"--data", Sequence(), "--speed", "0.5"});
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
