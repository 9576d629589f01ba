// A process hangs (SIGSTOP): its liveliness tells, the others go on, and when it comes back (SIGCONT) it catches up.

#include "processes/deployment.h"
#include "processes/run_output_check.h"

namespace portolan {
namespace {

class HangTest : public DeploymentTest {
 protected:
  using Heard = StatusWatch::Heard;

  void ExpectSoon(const std::function<bool(const Heard&)>& condition) {
    ASSERT_TRUE(watch().WaitUntil(condition, kProcessDeadline)) << Logs();
  }
  void StartAndMap(const std::string& speed) { StartAndMap(speed, Sequence()); }
  void StartAndMap(const std::string& speed, const std::string& data) {
    static_cast<void>(watch());  // hears of all processes from their start
    StartAll({"--data", data, "--speed", speed});
    WaitUntilMapping();
    ExpectSoon([](const Heard& heard) { return heard.alive == 4; });
  }
  /// Noticed by liveliness alone: the process is there, and says nothing.
  void StopAndExpectNoticed(const std::string& role) {
    Stop(role);
    ExpectSoon([](const Heard& heard) { return heard.alive == 3; });
  }
  void ContinueAndExpectNoticed(const std::string& role) {
    Continue(role);
    ExpectSoon([](const Heard& heard) { return heard.alive == 4; });
  }
  /// The tracker tracks so many frames more.
  void ExpectTrackingGoesOn(uint64_t frames) {
    const uint64_t goal = watch().heard().tracker->frame + frames;
    ExpectSoon([&](const Heard& heard) {
      return heard.TrackerIsAt(goal) && heard.tracker->state == TrackingState::kTracking;
    });
  }
};

TEST_F(HangTest, AnotherMapperTakesOverAndTheHungOneFindsItsEpochStale) {
  StartAndMap(RealTimeSpeed(0.3));
  const ProcessStatus first = *watch().heard().Of("backend_mapper");
  StopAndExpectNoticed("backend_mapper");
  ExpectTrackingGoesOn(3);
  Rename("backend_mapper", "hung");
  StartRole("backend_mapper");
  ExpectSoon([&](const Heard& heard) {
    const ProcessStatus* mapper = heard.Of("backend_mapper");
    return mapper->process != first.process && mapper->map == first.map && mapper->epoch > first.epoch;
  });
  const ProcessId second = watch().heard().Of("backend_mapper")->process;
  Continue("hung");
  ExpectSoon([&](const Heard& heard) { return heard.processes.at(first.process).state == "waiting for a map"; });
  const Revision revision = watch().heard().processes.at(second).revision;
  ExpectSoon([&](const Heard& heard) { return heard.processes.at(second).revision > revision; });
  ExpectGoodEnd();
  EXPECT_EQ(Interrupt("hung").code, 0);
  EXPECT_EQ(Report("atlas_server")["takeovers"], 1);
}

TEST_F(HangTest, AHungMapperThatNobodyReplacedGoesOnInItsEpoch) {
  StartAndMap(RealTimeSpeed(0.3));
  const ProcessStatus first = *watch().heard().Of("backend_mapper");
  StopAndExpectNoticed("backend_mapper");
  ExpectTrackingGoesOn(3);
  ContinueAndExpectNoticed("backend_mapper");
  ExpectSoon([&](const Heard& heard) { return heard.Of("backend_mapper")->revision > first.revision; });
  ExpectGoodEnd();
  EXPECT_EQ(watch().heard().Of("backend_mapper")->epoch, first.epoch);
  EXPECT_EQ(Report("atlas_server")["takeovers"], 0);
}

TEST_F(HangTest, AHungLoopCloserCatchesUp) {
  StartAndMap(RealTimeSpeed(0.3));
  const double taken = watch().heard().Figure("backend_mapper", "keyframes_taken");
  StopAndExpectNoticed("loop_closer");
  ExpectTrackingGoesOn(3);
  ExpectSoon([&](const Heard& heard) { return heard.Figure("backend_mapper", "keyframes_taken") > taken; });
  ContinueAndExpectNoticed("loop_closer");
  ExpectGoodEnd();
}

TEST_F(HangTest, AHungAtlasServerCatchesUpAndLeavesTheMapToItsOwner) {
  StartAndMap(RealTimeSpeed(0.3));
  const ProcessStatus mapper = *watch().heard().Of("backend_mapper");
  StopAndExpectNoticed("atlas_server");
  ExpectTrackingGoesOn(3);
  ExpectSoon([&](const Heard& heard) { return heard.Of("backend_mapper")->revision > mapper.revision; });
  const Revision meanwhile = watch().heard().Of("backend_mapper")->revision;
  ContinueAndExpectNoticed("atlas_server");
  ExpectSoon([&](const Heard& heard) {
    const ProcessStatus* atlas = heard.Of("atlas_server");
    return atlas->map == mapper.map && atlas->revision >= meanwhile;
  });
  ExpectGoodEnd();
  EXPECT_EQ(watch().heard().Of("backend_mapper")->epoch, mapper.epoch) << "nobody took the map from its owner";
}

/// So long that its map became dormant, in the next epoch.
TEST_F(HangTest, AHungFrontendFindsItsMapPutToRestAndGoesOnInIt) {
  StartAndMap("lockstep", InRounds(6));  // a film that outlasts the hang on any machine
  const ProcessStatus mapper = *watch().heard().Of("backend_mapper");
  StopAndExpectNoticed("frontend_tracker");
  const uint64_t frame = watch().heard().tracker->frame;
  ExpectSoon([&](const Heard& heard) { return heard.Of("backend_mapper")->state == "waiting for a map"; });
  ContinueAndExpectNoticed("frontend_tracker");
  ExpectSoon([&](const Heard& heard) {
    return heard.TrackerIsAt(frame + 1) && heard.tracker->state == TrackingState::kTracking &&
           heard.tracker->map == mapper.map;
  });
  EXPECT_EQ(WaitForFrontend().code, 0) << Logs();
  for (const char* role : {"backend_mapper", "loop_closer", "atlas_server"}) EXPECT_EQ(Interrupt(role).code, 0) << role;
  EXPECT_EQ(Report("frontend_tracker")["maps"], 1);
  EXPECT_GE(Report("atlas_server")["grants"], 3) << "to the mapper, to itself, to the mapper again";
}

}  // namespace
}  // namespace portolan
