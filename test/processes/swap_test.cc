// A process leaves its place to one that stands by, or dies and the other takes it; the run goes on, and nothing is
// lost.

#include <csignal>

#include "processes/deployment.h"
#include "processes/run_output_check.h"

namespace portolan {
namespace {

using ::testing::HasSubstr;

enum : int { kOk = 0, kUnreachable = 3, kRefused = 4 };  // docs/tool.md

class SwapTest : public DeploymentTest {
 protected:
  /// All four, and one that stands by, once the first of its role is there.
  void StartAllAndStandby(const std::string& role, const std::vector<std::string>& arguments,
                          const std::vector<std::string>& of_standby) {
    StartRole("atlas_server");
    StartRole("backend_mapper", arguments);
    StartRole("loop_closer");
    // One that still waits for the atlas_server would leave the place to a standby that is faster.
    ASSERT_TRUE(WaitUntil(role, [](const ProcessStatus& status) { return status.state == "waiting for a map"; }))
        << Logs();
    StartStandby(role, of_standby);
    ASSERT_TRUE(WaitUntil("standby/" + role, [](const ProcessStatus& status) { return status.state == kStandbyState; }))
        << Logs();
    StartRole("frontend_tracker", {"--data", Sequence(), "--speed", RealTimeSpeed(0.35)});
    ASSERT_TRUE(WaitUntil("backend_mapper", [](const ProcessStatus& status) {
      return FigureOf(status, "keyframes_taken") >= 4;
    })) << Logs();
    const MapId map = StatusOf("backend_mapper").map;
    ASSERT_TRUE(WaitUntil("standby/" + role, [&](const ProcessStatus& status) {
      return status.map == map && FigureOf(status, "keyframes") >= 3;
    })) << Logs();
  }
  /// As the tool prints it.
  nlohmann::json Swap(const std::string& role) {
    const Ended ended = Tool({"swap", role, "--json"});
    EXPECT_EQ(ended.code, kOk) << ended.output << Logs();
    nlohmann::json swap = nlohmann::json::parse(ended.standard_output, nullptr, false);
    EXPECT_TRUE(swap.is_object()) << ended.output;
    return swap.is_object() ? swap : nlohmann::json::object();
  }
  /// What both sides hold of each map is one thing, and there is at least one map.
  static void ExpectSame(const nlohmann::json& swap) {
    ASSERT_TRUE(swap.contains("maps") && !swap["maps"].empty()) << swap;
    for (const nlohmann::json& map : swap["maps"]) {
      EXPECT_TRUE(map.value("same", false)) << map;
      EXPECT_GE(map["before"]["keyframes"], 3) << map;
      for (const char* what : {"keyframes", "points", "hash"})
        EXPECT_EQ(map["before"][what], map["after"][what]) << map;
    }
  }
  void ExpectTookOver(const std::string& name, const std::string& state) {
    EXPECT_TRUE(WaitUntil(name, [&](const ProcessStatus& status) { return status.state == state; }))
        << StatusOf(name).state << Logs();
  }
  /// The frontend came to its end in one map; `names` are told to end, and do.
  void ExpectGoodEnd(const std::vector<std::string>& names) {
    const Ended frontend = WaitForFrontend();
    ASSERT_EQ(frontend.code, 0) << frontend.output << Logs();
    for (const std::string& name : names) EXPECT_EQ(Interrupt(name).code, 0) << name;
    EXPECT_GT(ExpectTrajectory(Out() + "/trajectory.txt").size(), 0.8 * static_cast<double>(NumFrames()));
    ExpectAccurate(Truth(), Out() + "/trajectory.txt", 0.01);
    EXPECT_EQ(Report("frontend_tracker")["maps"], 1);
  }
  nlohmann::json StandbyReport(const std::string& name) const {
    return ReadReport(StandbyOut() + "/" + name + ".json");
  }
};

TEST_F(SwapTest, AMapperLeavesItsPlaceToOneOfTheOtherVendor) {
  ASSERT_NO_FATAL_FAILURE(StartAllAndStandby("backend_mapper", {"--dds", "fastdds"}, {"--dds", "cyclonedds"}));
  const ProcessStatus first = StatusOf("backend_mapper");
  const uint64_t frame = watch().heard().tracker->frame;
  const nlohmann::json swap = Swap("mapper");
  ExpectSame(swap);
  EXPECT_EQ(swap["from"], ToString(first.process));
  EXPECT_EQ(swap["maps"][0]["after"]["epoch"], first.epoch + 1);
  EXPECT_EQ(WaitFor("backend_mapper").code, 0) << Logs();
  EXPECT_GT(Report("backend_mapper")["keyframes_taken"], 0);
  EXPECT_TRUE(watch().WaitUntil([&](const StatusWatch::Heard& heard) { return heard.TrackerIsAt(frame + 5); },
                                kProcessDeadline));
  const size_t before = swap["maps"][0]["before"]["keyframes"];
  EXPECT_TRUE(WaitUntil("standby/backend_mapper",
                        [&](const ProcessStatus& status) {
                          return status.state == "mapping" && status.map == first.map &&
                                 FigureOf(status, "keyframes") > static_cast<double>(before);
                        }))
      << "it goes on with the map" << Logs();
  EXPECT_EQ(StatusOf("standby/backend_mapper").vendor, "cyclonedds");
  ExpectGoodEnd({"standby/backend_mapper", "loop_closer", "atlas_server"});
  ExpectSameMaps(Report("atlas_server"), Report("loop_closer"));
  EXPECT_EQ(Report("atlas_server")["swaps"], 1);
}

TEST_F(SwapTest, AStandbyMapperGoesOnAfterTheFirstWasKilled) {
  ASSERT_NO_FATAL_FAILURE(StartAllAndStandby("backend_mapper", {}, {}));
  const ProcessStatus first = StatusOf("backend_mapper");
  Kill("backend_mapper");
  EXPECT_TRUE(WaitUntil("standby/backend_mapper", [&](const ProcessStatus& status) {
    return status.state == "mapping" && status.map == first.map && status.epoch > first.epoch &&
           FigureOf(status, "keyframes") >= FigureOf(first, "keyframes");
  })) << Logs();
  ExpectGoodEnd({"standby/backend_mapper", "loop_closer", "atlas_server"});
  ExpectSameMaps(Report("atlas_server"), Report("loop_closer"));
  EXPECT_EQ(Report("atlas_server")["takeovers"], 1);
}

TEST_F(SwapTest, ALoopCloserLeavesItsPlace) {
  ASSERT_NO_FATAL_FAILURE(StartAllAndStandby("loop_closer", {}, {"--dds", "cyclonedds"}));
  const nlohmann::json swap = Swap("loop_closer");
  EXPECT_EQ(swap["maps"].size(), 1u) << swap;
  EXPECT_EQ(WaitFor("loop_closer").code, 0) << Logs();
  ExpectTookOver("standby/loop_closer", "following");
  ExpectGoodEnd({"backend_mapper", "standby/loop_closer", "atlas_server"});
  ExpectSameMaps(Report("atlas_server"), StandbyReport("loop_closer"));
  EXPECT_GT(StandbyReport("loop_closer")["loop_counters"]["looked_at"], 0);
}

/// Then the standby dies in its turn, and one more takes its place.
TEST_F(SwapTest, AnAtlasServerLeavesItsPlaceAndItsFile) {
  const std::vector<std::string> same_store = {"--store", Out() + "/atlas.db"};
  ASSERT_NO_FATAL_FAILURE(StartAllAndStandby("atlas_server", {}, same_store));
  EXPECT_EQ(FigureOf(StatusOf("standby/atlas_server"), "waits_for_store"), 1);
  const ProcessStatus mapper = StatusOf("backend_mapper");
  const nlohmann::json swap = Swap("atlas_server");
  ExpectSame(swap);
  EXPECT_EQ(WaitFor("atlas_server").code, 0) << Logs();
  ExpectTookOver("standby/atlas_server", "following");
  EXPECT_EQ(FigureOf(StatusOf("standby/atlas_server"), "waits_for_store"), 0) << "the file is its own";
  EXPECT_THAT(Tool({"maps"}).output, HasSubstr("active, owner " + ToString(mapper.process)));
  ExpectGoodEnd({"backend_mapper", "loop_closer", "standby/atlas_server"});
  ExpectSameMaps(StandbyReport("atlas_server"), Report("loop_closer"));
  EXPECT_EQ(StandbyReport("atlas_server")["stored_keyframes"], StandbyReport("atlas_server")["keyframes"]);
  EXPECT_EQ(StatusOf("backend_mapper").epoch, mapper.epoch) << "nobody took the map from its owner";
}

/// With a store of its own, as on another machine.
TEST_F(SwapTest, AStandbyAtlasServerGoesOnAfterTheFirstWasKilled) {
  ASSERT_NO_FATAL_FAILURE(StartAllAndStandby("atlas_server", {}, {}));
  const ProcessStatus mapper = StatusOf("backend_mapper");
  Kill("atlas_server");
  ExpectTookOver("standby/atlas_server", "following");
  EXPECT_THAT(Tool({"maps"}).output, HasSubstr(ToString(mapper.map)));
  ExpectGoodEnd({"backend_mapper", "loop_closer", "standby/atlas_server"});
  ExpectSameMaps(StandbyReport("atlas_server"), Report("loop_closer"));
  EXPECT_EQ(StandbyReport("atlas_server")["stored_keyframes"], StandbyReport("atlas_server")["keyframes"]);
  EXPECT_EQ(StatusOf("backend_mapper").epoch, mapper.epoch) << "nobody took the map from its owner";
}

TEST_F(SwapTest, WhatCannotBeIsRefusedWithTheReason) {
  EXPECT_EQ(Tool({"swap", "mapper", "--timeout", "1"}).code, kUnreachable);
  StartRole("atlas_server");
  ASSERT_TRUE(WaitUntil("atlas_server", [](const ProcessStatus&) { return true; })) << Logs();
  const auto expect_refused = [&](const std::string& role, const std::string& reason) {
    const Ended ended = Tool({"swap", role});
    EXPECT_EQ(ended.code, kRefused) << ended.output;
    EXPECT_THAT(ended.output, HasSubstr(reason)) << role;
  };
  expect_refused("mapper", "there is no backend_mapper");
  expect_refused("atlas_server", "no standby for the atlas_server");
  StartRole("backend_mapper");
  ASSERT_TRUE(WaitUntil("backend_mapper", [](const ProcessStatus& status) {
    return status.state == "waiting for a map";
  })) << Logs();
  expect_refused("mapper", "no standby for the backend_mapper of robot 0: start one with --standby");
  StartStandby("backend_mapper");
  ASSERT_TRUE(WaitUntil("standby/backend_mapper", [](const ProcessStatus& status) {
    return status.state == kStandbyState;
  })) << Logs();
  // Without a map there is nothing to hold: the place passes on all the same.
  EXPECT_THAT(Tool({"swap", "mapper"}).output, HasSubstr("ok: backend_mapper of robot 0"));
  EXPECT_EQ(WaitFor("backend_mapper").code, 0) << Logs();
  expect_refused("mapper", "no standby");
  for (const char* name : {"standby/backend_mapper", "atlas_server"}) EXPECT_EQ(Interrupt(name).code, 0) << name;
}

}  // namespace
}  // namespace portolan
