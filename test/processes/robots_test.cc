// Two robots in one street with one atlas_server: their maps become one, and the map that both are in passes on when
// the robot whose mapper owns it leaves or dies.

#include <filesystem>
#include <regex>

#include "dataset/trajectory_evaluation.h"
#include "processes/deployment.h"
#include "processes/run_output_check.h"

namespace portolan {
namespace {

enum : int { kOk = 0, kInterrupted = 130 };  // docs/configuration.md

constexpr const char* kPartition = "fleet";
constexpr int kManyRounds = 8;      // more than any test takes
constexpr double kMaxErrorM = 0.1;  // a robot leaves 0.02 m on the 27 m of the street
constexpr int64_t kHourNs = 3'600'000'000'000;

struct Robot {
  int number;
  std::string vendor, data;

  std::string Name(const std::string& role) const { return "robot_" + std::to_string(number) + "/" + role; }
  std::string Frontend() const { return Name("frontend_tracker"); }
  std::string Mapper() const { return Name("backend_mapper"); }
  std::string LoopCloser() const { return Name("loop_closer"); }
};

/// In real time: in lockstep robots that share a map wait for each other for many seconds.
class RobotsTest : public DeploymentTest {
 protected:
  RobotsTest() { partition_ = kPartition; }

  /// @param parts pieces of the street (see make_sequence.py) for it to drive, so many times.
  Robot MakeRobot(int number, const std::string& vendor, const std::string& parts, int times) {
    std::string all = parts;
    for (int i = 1; i < times; ++i) all += "," + parts;
    const std::string data = folder_.Path("street_of_robot_" + std::to_string(number));
    std::filesystem::rename(InPieces(all), data);
    return {number, vendor, data};
  }
  void StartAtlas() { StartRole("atlas_server", {"--set", std::string("dds.partition=") + kPartition}); }
  void StartRobot(const Robot& robot) {
    std::vector<std::string> arguments = {"--set",   std::string("dds.partition=") + kPartition,
                                          "--robot", std::to_string(robot.number),
                                          "--dds",   robot.vendor};
    for (const std::string& name : {robot.Mapper(), robot.LoopCloser()}) StartRole(name, arguments);
    arguments.insert(arguments.end(), {"--data", robot.data, "--speed", RealTimeSpeed(0.5)});
    StartRole(robot.Frontend(), arguments);
  }
  void Await(const std::string& name, const std::function<bool(const ProcessStatus&)>& condition) {
    ASSERT_TRUE(WaitUntil(name, condition)) << name << ": " << StatusOf(name).state << Logs();
  }
  void WaitUntilIn(const Robot& robot, MapId map) {
    Await(robot.Frontend(), [&](const ProcessStatus& status) { return status.map == map; });
  }
  /// It tracks so many frames more.
  void GoOnFor(const Robot& robot, double frames) {
    const double end = FigureOf(StatusOf(robot.Frontend()), "tracked") + frames;
    Await(robot.Frontend(), [&](const ProcessStatus& status) { return FigureOf(status, "tracked") >= end; });
  }
  /// Its mapper goes on with the map of another, of which this was the last word.
  void WaitUntilPassedOn(const Robot& robot, const ProcessStatus& before) {
    Await(robot.Mapper(), [&](const ProcessStatus& status) {
      return status.map == before.map && status.epoch > before.epoch && status.state == "mapping";
    });
  }
  /// As a user ends a robot whose run is not over.
  void Leave(const Robot& robot) {
    EXPECT_EQ(Interrupt(robot.Frontend()).code, kInterrupted);
    for (const std::string& name : {robot.Mapper(), robot.LoopCloser()}) EXPECT_EQ(Interrupt(name).code, kOk) << name;
  }

  /// Frames that it saw and did not track, as it told last.
  double NumLost(const Robot& robot) {
    const ProcessStatus status = StatusOf(robot.Frontend());
    return FigureOf(status, "frames") - FigureOf(status, "tracked");
  }
  /// None since so many were, unless for frames that a busy machine dropped.
  void ExpectNoneLostSince(const Robot& robot, double lost) {
    EXPECT_LE(NumLost(robot), lost + FigureOf(StatusOf(robot.Frontend()), "frames_dropped")) << robot.Frontend();
  }
  /// In the frame of the map that they share: the poses of all of them, aligned to the ground truth as one.
  void ExpectAccurateTogether(const std::vector<Robot>& robots) const {
    Trajectory truth, estimate;
    for (const Robot& robot : robots) {
      const auto append = [&](const std::string& file, Trajectory* all) {
        for (TrajectoryPose pose : ExpectTrajectory(file)) {
          pose.stamp.ns += kHourNs * robot.number;  // they drive at the same times
          all->push_back(pose);
        }
      };
      append(robot.data + "/groundtruth.txt", &truth);
      append(Out() + "/" + robot.Name("trajectory.txt"), &estimate);
    }
    const Result<Evaluation> evaluation = EvaluateTrajectory(truth, estimate, {});
    ASSERT_TRUE(evaluation.ok()) << evaluation.error().message;
    ASSERT_TRUE(evaluation->joined.truth_from_map) << evaluation->joined.failure;
    EXPECT_EQ(evaluation->joined.ate.count, estimate.size());
    EXPECT_LT(evaluation->joined.ate.rmse, kMaxErrorM);
  }
};

TEST_F(RobotsTest, TheSmallerOfTwoMapsGoesIntoTheLargerAndItsOwnerLeaves) {
  // From both ends of the street to its middle and back.
  const std::vector<Robot> robots = {MakeRobot(0, "fastdds", "0-70,69-1", kManyRounds),
                                     MakeRobot(1, "cyclonedds", "119-50,51-118", kManyRounds)};
  // Both wait for the atlas_server, so that each begins before it knows of a map in which it could be.
  for (const Robot& robot : robots) StartRobot(robot);
  for (const Robot& robot : robots) {
    ASSERT_NO_FATAL_FAILURE(
        Await(robot.Frontend(), [](const ProcessStatus& status) { return status.state == "waiting for peers"; }));
  }
  StartAtlas();
  std::vector<double> lost;
  for (const Robot& robot : robots) {
    ASSERT_NO_FATAL_FAILURE(GoOnFor(robot, 1));
    lost.push_back(NumLost(robot));
  }
  ASSERT_NO_FATAL_FAILURE(
      Await("atlas_server", [](const ProcessStatus& status) { return FigureOf(status, "fusions") == 1; }));
  const nlohmann::json maps = ToolJson({"maps", "--json", "--partition", kPartition})["maps"];
  ASSERT_EQ(maps.size(), 1u) << maps;
  const bool is_of_first = maps[0]["owner"] == ToString(StatusOf(robots[0].Mapper()).process);
  const Robot &owner = robots[is_of_first ? 0 : 1], &other = robots[is_of_first ? 1 : 0];
  ASSERT_NO_FATAL_FAILURE(
      Await(owner.Mapper(), [&](const ProcessStatus& status) { return ToString(status.map) == maps[0]["map"]; }));
  const ProcessStatus before = StatusOf(owner.Mapper());
  EXPECT_EQ(maps[0]["owner"], ToString(before.process));
  for (const Robot& robot : robots) ASSERT_NO_FATAL_FAILURE(WaitUntilIn(robot, before.map));
  for (const Robot& robot : robots) ASSERT_NO_FATAL_FAILURE(GoOnFor(robot, 30));

  Leave(owner);
  ASSERT_NO_FATAL_FAILURE(WaitUntilPassedOn(other, before));
  ASSERT_NO_FATAL_FAILURE(GoOnFor(other, 30));
  Leave(other);
  EXPECT_EQ(Interrupt("atlas_server").code, kOk);

  const nlohmann::json atlas = Report("atlas_server");
  EXPECT_EQ(atlas["maps"], 1);
  EXPECT_EQ(atlas["fusions"], 1);
  EXPECT_EQ(atlas["switches"], 0);
  std::smatch sizes;
  const std::string log = ReadWholeFile(Out() + "/logs/atlas_server.log");
  ASSERT_TRUE(std::regex_search(log, sizes, std::regex(R"(\((\d+) keyframes\) is to go into map \S+ \((\d+))"))) << log;
  EXPECT_LE(std::stoi(sizes[1]), std::stoi(sizes[2]));
  for (size_t i = 0; i < robots.size(); ++i) {
    EXPECT_EQ(Report(robots[i].Frontend())["maps"], 1);
    ExpectNoneLostSince(robots[i], lost[i]);
  }
  ExpectAccurateTogether(robots);
}

/// And comes back, late in its turn, to a map that is the other's now.
TEST_F(RobotsTest, ALateRobotGoesOnWithTheMapOfOneThatDies) {
  const Robot first = MakeRobot(0, "cyclonedds", "0-60,59-1", kManyRounds);
  const Robot second = MakeRobot(1, "fastdds", "10-60,59-30,31-119", 1);
  StartAtlas();
  StartRobot(first);
  ASSERT_NO_FATAL_FAILURE(GoOnFor(first, 30));
  const ProcessStatus before = StatusOf(first.Mapper());
  StartRobot(second);
  ASSERT_NO_FATAL_FAILURE(WaitUntilIn(second, before.map));
  ASSERT_NO_FATAL_FAILURE(GoOnFor(second, 1));
  const double lost = NumLost(second);
  for (const std::string& name : {first.Mapper(), first.Frontend(), first.LoopCloser()}) Kill(name);
  ASSERT_NO_FATAL_FAILURE(WaitUntilPassedOn(second, before));

  StartRobot(first);
  ASSERT_NO_FATAL_FAILURE(WaitUntilIn(first, before.map));
  ASSERT_NO_FATAL_FAILURE(GoOnFor(first, 1));
  Leave(first);
  EXPECT_EQ(WaitFor(second.Frontend()).code, kOk) << Logs();
  EXPECT_EQ(StatusOf(second.Mapper()).map, before.map);
  for (const std::string& name : {second.Mapper(), second.LoopCloser(), std::string("atlas_server")})
    EXPECT_EQ(Interrupt(name).code, kOk) << name;

  EXPECT_EQ(Report("atlas_server")["maps"], 1);
  EXPECT_EQ(Report("atlas_server")["takeovers"], 1);
  const nlohmann::json tracker = Report(second.Frontend());
  EXPECT_EQ(tracker["maps"], 1);
  EXPECT_EQ(tracker["keyframes_unacknowledged"], 0);
  EXPECT_GT(Report(second.Mapper())["keyframes_taken"], 0) << "it came to what the other had not seen";
  ExpectSameMaps(Report("atlas_server"), Report(second.LoopCloser()));
  ExpectNoneLostSince(second, lost);
  ExpectAccurateTogether({first, second});
}

}  // namespace
}  // namespace portolan
