// A look around a room, a turn and a quarter: the last quarter sees what the first saw, and the loop is closed (paper
// Sec. 5).

#include <csignal>

#include "processes/deployment.h"
#include "processes/run_output_check.h"

namespace portolan {
namespace {

constexpr double kMaxErrorShare = 0.02;  // of the way

class LoopTest : public DeploymentTest {
 protected:
  static std::string Room() { return Sequence("room"); }
  static void ExpectClosures(const nlohmann::json& report) {
    ASSERT_TRUE(report["closures"].is_array());
    int applied = 0;
    for (const nlohmann::json& closure : report["closures"]) {
      applied += closure["applied"].get<bool>() ? 1 : 0;
      EXPECT_GT(closure["stamp_ns"].get<int64_t>(), closure["matched_stamp_ns"].get<int64_t>());
      EXPECT_GT(closure["inliers"], 0);
    }
    EXPECT_EQ(report["loops"], applied);
    EXPECT_GE(applied, 1);
  }
};

TEST_F(LoopTest, IsClosedAlikeOnBothVendors) {
  std::string first;
  for (const char* vendor : {"fastdds", "cyclonedds"}) {
    const Ended run = RunToEnd(RunCommand({"--data", Room(), "--speed", "lockstep", "--dds", vendor}));
    ASSERT_EQ(run.code, 0) << run.output << Logs();
    ExpectClosures(Report("summary"));
    ExpectAccurate(Room() + "/groundtruth.txt", Out() + "/trajectory.txt", kMaxErrorShare);
    const std::string trajectory = ReadWholeFile(Out() + "/trajectory.txt");
    if (first.empty()) first = trajectory;
    // Whole trajectories would be lines too long for colcon.
    EXPECT_TRUE(trajectory == first) << "lockstep waits for the loop_closer too: " << vendor;
  }
}

TEST_F(LoopTest, IsNotLookedForWhereSwitchedOff) {
  const Ended run = RunToEnd(RunCommand({"--data", Room(), "--speed", "lockstep", "--set", "loop.enabled=false"}));
  ASSERT_EQ(run.code, 0) << run.output << Logs();
  EXPECT_EQ(Report("summary")["loops"], 0);
  EXPECT_EQ(Report("summary")["loop_counters"]["looked_at"], 0);
}

TEST_F(LoopTest, IsClosedByALoopCloserThatCameInBetween) {
  StartAll({"--data", Room(), "--speed", "lockstep"});
  ASSERT_TRUE(
      watch().WaitUntil([](const StatusWatch::Heard& heard) { return heard.TrackerIsAt(300); }, kProcessDeadline))
      << Logs();
  Kill("loop_closer");
  StartRole("loop_closer");
  const Ended frontend = WaitForFrontend();
  ASSERT_EQ(frontend.code, 0) << frontend.output << Logs();
  for (const char* role : {"backend_mapper", "loop_closer", "atlas_server"}) EXPECT_EQ(Interrupt(role).code, 0) << role;
  ExpectClosures(Report("loop_closer"));
  // It has the map that the robot is in; ones given up before it came it need not have.
  const nlohmann::json followed = Report("loop_closer")["map_hash"], stored = Report("atlas_server")["map_hash"];
  EXPECT_FALSE(followed.empty());
  for (const auto& [map, hash] : followed.items()) EXPECT_EQ(stored.value(map, ""), hash.get<std::string>()) << map;
}

}  // namespace
}  // namespace portolan
