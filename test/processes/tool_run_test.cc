// What the command line tool asks of a run that goes on: maps begun, gone into and fused by order, a robot that waits,
// and one that changes no map.

#include <algorithm>

#include "map/map_file.h"
#include "processes/deployment.h"
#include "processes/run_output_check.h"

namespace portolan {
namespace {

using ::testing::HasSubstr;

enum : int { kOk = 0, kRefused = 4, kInterrupted = 130 };  // docs/tool.md

// More than all orders of a test take: a robot that localises only does not wait for a mapper, and is through 300
// frames a second.
constexpr int kManyRounds = 120;
constexpr int kFewRounds = 3;  // to be driven to the end
constexpr double kMaxErrorShare = 0.02;

class ToolRunTest : public DeploymentTest {
 protected:
  void StartRun(const std::string& vendor, int rounds, const std::vector<std::string>& of_atlas = {}) {
    vendor_ = vendor;
    rounds_ = rounds;
    data_ = InRounds(rounds);
    std::vector<std::string> atlas_arguments = {"--dds", vendor};
    atlas_arguments.insert(atlas_arguments.end(), of_atlas.begin(), of_atlas.end());
    StartRole("atlas_server", atlas_arguments);
    for (const char* role : {"backend_mapper", "loop_closer"}) StartRole(role, {"--dds", vendor});
    StartRole("frontend_tracker", {"--dds", vendor, "--data", data_, "--speed", "lockstep"});
  }
  void Order(std::vector<std::string> command, const std::string& output = "ok") {
    command.insert(command.end(), {"--dds", vendor_});
    ExpectTool(command, kOk, output);
  }
  uint64_t Frame() { return watch().heard().tracker->frame; }
  void GoOnFor(uint64_t frames) {
    const uint64_t end = (watch().heard().tracker ? Frame() : 0) + frames;
    ASSERT_TRUE(
        watch().WaitUntil([&](const StatusWatch::Heard& heard) { return heard.TrackerIsAt(end); }, kProcessDeadline))
        << Logs();
  }
  MapId TrackersMap() { return StatusOf("frontend_tracker").map; }
  void WaitUntilTracked(MapId map) {
    const auto is_tracked = [&](const StatusWatch::Heard& heard) {
      return heard.tracker->state == TrackingState::kTracking && heard.tracker->map == map;
    };
    ASSERT_TRUE(watch().WaitUntil(is_tracked, kProcessDeadline)) << Logs();
    ASSERT_TRUE(WaitUntil("frontend_tracker", [&](const ProcessStatus& status) { return status.map == map; }))
        << Logs();
  }
  /// By order, while the camera is tracked in another. @return the new map.
  MapId BeginMap() {
    const MapId before = TrackersMap();
    Order({"new-map"});
    const auto is_elsewhere = [&](const ProcessStatus& status) { return status.map.IsValid() && status.map != before; };
    EXPECT_TRUE(WaitUntil("frontend_tracker", is_elsewhere)) << Logs();
    EXPECT_TRUE(WaitUntil("atlas_server", [](const ProcessStatus& status) { return FigureOf(status, "links") == 1; }))
        << Logs();
    return TrackersMap();
  }
  std::string Exported() const { return folder_.Path("exported.pmap"); }
  Map Export(MapId map) {
    Order({"export", ToString(map), "--map", Exported()}, "keyframes");
    const auto exported = ReadMapFile(Exported());
    EXPECT_TRUE(exported.ok());
    return exported.ok() ? *RestoreMap(exported->at(0), nullptr) : Map(map, 0);
  }
  /// The tracker is stopped by the user; the others end as they should.
  void EndRun() {
    EXPECT_EQ(Interrupt("frontend_tracker").code, kInterrupted) << Logs();
    for (const char* role : {"backend_mapper", "loop_closer", "atlas_server"})
      EXPECT_EQ(Interrupt(role).code, 0) << role;
  }

  /// To a share of one way there, though the ground truth has all the rounds.
  void ExpectAccurateRun() {
    ExpectAccurate(data_ + "/groundtruth.txt", Out() + "/trajectory.txt", kMaxErrorShare / (2 * rounds_));
  }

  std::string vendor_, data_;
  int rounds_ = 0;
};

size_t NumShared(const Map& map, const Map& other) {
  return static_cast<size_t>(std::count_if(other.keyframes().begin(), other.keyframes().end(), [&](const auto& entry) {
    return map.FindKeyFrame(entry.first) != nullptr;
  }));
}

class ToolRunVendorsTest : public ToolRunTest, public ::testing::WithParamInterface<const char*> {};

/// The one in which the robot is not is paged meanwhile.
TEST_P(ToolRunVendorsTest, AMapIsBegunAndAnotherGoneIntoAndBothFused) {
  StartRun(GetParam(), kManyRounds, {"--set", "atlas.maps_mb=0"});
  ASSERT_NO_FATAL_FAILURE(GoOnFor(kRound));
  const MapId first = TrackersMap();
  const MapId second = BeginMap();
  const nlohmann::json graph = ToolJson({"graph", "--json"});
  ASSERT_EQ(graph["links"].size(), 1u) << graph;
  EXPECT_EQ(graph["links"][0]["origin"], "new_map");
  ASSERT_NO_FATAL_FAILURE(GoOnFor(kRound));

  Order({"activate", ToString(first)}, "ok: robot 0 is in map " + ToString(first));
  ASSERT_NO_FATAL_FAILURE(WaitUntilTracked(first));
  const Map into = Export(first), other = Export(second);
  EXPECT_GE(other.keyframes().size(), 2u);
  Order({"fuse", ToString(first), ToString(second)},
        "ok: map " + ToString(second) + " is part of map " + ToString(first));
  EXPECT_EQ(ToolJson({"maps", "--json"})["maps"].size(), 1u);
  const Map fused = Export(first);
  // Both saw the same piece of street: how many of the keyframes are redundant now is up to the mapper.
  EXPECT_GT(NumShared(fused, into), 0u);
  EXPECT_GT(NumShared(fused, other), 0u);
  ASSERT_NO_FATAL_FAILURE(GoOnFor(10));
  EXPECT_EQ(watch().heard().tracker->map, first);

  EndRun();
  const nlohmann::json tracker = Report("frontend_tracker"), atlas = Report("atlas_server");
  for (const nlohmann::json& report : {tracker, atlas}) {
    EXPECT_EQ(report["maps"], 1);
    EXPECT_EQ(report["switches"], 1);
    EXPECT_EQ(report["fusions"], 1);
  }
  EXPECT_GE(atlas["paging"]["loads"], 1);
  EXPECT_EQ(atlas["paging"]["load_failures"], 0);
  EXPECT_EQ(tracker["refused_moves"], 0);
  EXPECT_EQ(tracker["unlinked_maps"], 0);
  ExpectAccurateRun();
}

INSTANTIATE_TEST_SUITE_P(Vendors, ToolRunVendorsTest, ::testing::Values("fastdds", "cyclonedds"),
                         [](const auto& parameter) { return std::string(parameter.param); });

/// The tracker has nothing to go by but what it sees. Maps in which it is not are paged.
TEST_F(ToolRunTest, AMapFromAFileIsGoneIntoThoughNobodyKnowsWhereItLies) {
  StartRun("fastdds", kManyRounds, {"--set", "atlas.join_maps=false", "--set", "atlas.maps_mb=0"});
  ASSERT_NO_FATAL_FAILURE(GoOnFor(kRound));
  const MapId first = TrackersMap();
  const Map map = Export(first);
  const MapId second = BeginMap();
  Order({"delete", ToString(first)});
  EXPECT_EQ(ToolJson({"graph", "--json"})["links"].size(), 0u);
  Order({"load", Exported()}, "ok: " + ToString(first));

  Order({"activate", ToString(first)}, "ok: robot 0 is in map " + ToString(first));
  ASSERT_NO_FATAL_FAILURE(WaitUntilTracked(first));
  EXPECT_GT(NumShared(Export(first), map), 0u);
  const nlohmann::json graph = ToolJson({"graph", "--json"});
  EXPECT_EQ(graph["links"].size(), 1u) << graph << ": the frame with which it went over saw both";
  EndRun();
  EXPECT_EQ(Report("frontend_tracker")["switches"], 1);
  EXPECT_EQ(Report("atlas_server")["switches"], 1);
  EXPECT_EQ(Report("atlas_server")["map_hash"].count(ToString(second)), 1u) << "it is kept, dormant";
  ExpectAccurateRun();
}

TEST_F(ToolRunTest, APausedRobotLosesNothingAndItsMapIsAdjusted) {
  StartRun("fastdds", kFewRounds);
  ASSERT_NO_FATAL_FAILURE(WaitUntilMapping());
  Order({"pause"});
  ASSERT_TRUE(WaitUntil("frontend_tracker", [](const ProcessStatus& status) {
    return FigureOf(status, "paused") == 1;
  })) << Logs();
  EXPECT_THAT(StatusOf("frontend_tracker").state, HasSubstr("paused, tracking"));
  const MapId map = TrackersMap();
  ExpectTool({"activate", ToString(map)}, kRefused, "paused");
  const double revision = ToolJson({"maps", "--json"})["maps"][0]["revision"];
  const uint64_t frame = Frame();
  const ProcessStatus before = StatusOf("loop_closer");

  Order({"global-ba"}, "ok: the loop_closer of robot 0 adjusts map " + ToString(map));
  const auto rises = [&](const ProcessStatus& status, const std::string& figure) {
    return FigureOf(status, figure) > FigureOf(before, figure);
  };
  // The mapper has had time to make the map as good as it can be.
  EXPECT_TRUE(WaitUntil("loop_closer", [&](const ProcessStatus& status) {
    return rises(status, "global_ba") || rises(status, "global_ba_fruitless");
  })) << Logs();
  const double adjusted = ToolJson({"maps", "--json"})["maps"][0]["revision"];
  EXPECT_EQ(adjusted > revision, rises(StatusOf("loop_closer"), "global_ba"));
  EXPECT_EQ(Frame(), frame) << "nothing else has changed the map";

  Order({"resume"});
  ASSERT_EQ(WaitForFrontend().code, 0) << Logs();
  for (const char* role : {"backend_mapper", "loop_closer", "atlas_server"}) EXPECT_EQ(Interrupt(role).code, 0) << role;
  const nlohmann::json tracker = Report("frontend_tracker"), mapper = Report("backend_mapper");
  EXPECT_EQ(tracker["frames"], kRound * kFewRounds);
  EXPECT_EQ(tracker["dropped"], 0);
  EXPECT_GE(tracker["tracked"], kRound * kFewRounds - 20);
  EXPECT_EQ(tracker["keyframes_unacknowledged"], 0);
  EXPECT_EQ(tracker["keyframes_sent"], mapper["keyframes_taken"].get<int>() + mapper["keyframes_refused"].get<int>());
  EXPECT_EQ(tracker["maps"], 1);
  ExpectAccurateRun();
}

/// And then maps again: in a new map, which is fused while the robot is in it.
TEST_F(ToolRunTest, ARobotThatLocalisesOnlyChangesNoMap) {
  StartRun("fastdds", kManyRounds);
  ASSERT_NO_FATAL_FAILURE(GoOnFor(kRound));
  const MapId first = TrackersMap();
  Order({"localize-only", "on"});
  ASSERT_TRUE(WaitUntil("frontend_tracker", [](const ProcessStatus& status) {
    return FigureOf(status, "localization_only") == 1;
  })) << Logs();
  EXPECT_THAT(StatusOf("frontend_tracker").state, HasSubstr("localization only"));
  ASSERT_NO_FATAL_FAILURE(GoOnFor(2));  // in lockstep all is done by then that was begun before
  const Map before = Export(first);
  ExpectTool({"new-map"}, kRefused, "robot 0 localises only");
  ASSERT_NO_FATAL_FAILURE(GoOnFor(kRound));
  EXPECT_EQ(watch().heard().tracker->state, TrackingState::kTracking);
  EXPECT_EQ(watch().heard().tracker->map, first);
  const Map after = Export(first);
  EXPECT_EQ(after.revision(), before.revision());
  EXPECT_EQ(HashMap(after), HashMap(before));

  Order({"localize-only", "off"});
  ASSERT_TRUE(WaitUntil("frontend_tracker", [](const ProcessStatus& status) {
    return FigureOf(status, "localization_only") == 0;
  })) << Logs();
  const MapId second = BeginMap();
  ASSERT_NO_FATAL_FAILURE(GoOnFor(kRound));
  Order({"fuse", "1", "2"}, "ok: map " + ToString(second) + " is part of map " + ToString(first));
  ASSERT_NO_FATAL_FAILURE(WaitUntilTracked(first));
  EndRun();
  EXPECT_EQ(Report("frontend_tracker")["maps"], 1);
  EXPECT_EQ(Report("frontend_tracker")["fusions"], 1);
  EXPECT_EQ(Report("frontend_tracker")["switches"], 0) << "it stayed where it was, which is in the other map now";
  EXPECT_EQ(Report("atlas_server")["fusions"], 1);
  ExpectAccurateRun();
}

}  // namespace
}  // namespace portolan
