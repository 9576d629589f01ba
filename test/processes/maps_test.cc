// Many maps in one run (paper Sec. 3.4 and 6): a map that is full is left for one that overlaps it, a camera that sees
// nothing for a while is found again where it was, and a saved atlas is gone on with.

#include <filesystem>

#include "processes/process_test.h"
#include "processes/run_output_check.h"

namespace portolan {
namespace {

constexpr double kMaxErrorShare = 0.02;  // of the way
constexpr int kBlackFrames = 15;         // more than the five after which the tracker is lost

class MapsTest : public ProcessTest {
 protected:
  void Run(const std::vector<std::string>& arguments) {
    const Ended run = RunToEnd(RunCommand(arguments));
    ASSERT_EQ(run.code, 0) << run.output << Logs();
    summary_ = Report("summary");
  }
  int Summary(const std::string& key) const { return summary_.at(key).get<int>(); }

  nlohmann::json summary_;
};

TEST_F(MapsTest, AFullMapIsLeftForOneThatOverlapsIt) {
  for (const char* vendor : {"fastdds", "cyclonedds"}) {
    ASSERT_NO_FATAL_FAILURE(
        Run({"--data", Sequence(), "--speed", "lockstep", "--dds", vendor, "--set", "tracker.max_map_keyframes=6"}));
    EXPECT_GE(Summary("maps"), 2) << vendor;
    EXPECT_EQ(Summary("unlinked_maps"), 0) << vendor;
    EXPECT_GE(Summary("tracked"), static_cast<int>(NumFrames()) - 10) << vendor;
    ExpectAccurate(Truth(), Out() + "/trajectory.txt", kMaxErrorShare);
  }
}

TEST_F(MapsTest, ACameraThatSawNothingIsFoundWhereItWas) {
  const std::string data = InPieces("0-79,black:" + std::to_string(kBlackFrames) + ",40-119");
  ASSERT_NO_FATAL_FAILURE(Run({"--data", data, "--speed", "lockstep"}));
  EXPECT_EQ(Summary("frames"), 160 + kBlackFrames);
  EXPECT_GE(Summary("tracked"), 145);
  EXPECT_EQ(Summary("maps"), 1);
  ExpectAccurate(data + "/groundtruth.txt", Out() + "/trajectory.txt", kMaxErrorShare);
}

TEST_F(MapsTest, ASavedAtlasIsGoneOnWith) {
  ASSERT_NO_FATAL_FAILURE(Run({"--data", Sequence(), "--speed", "lockstep"}));
  const std::string atlas = folder_.Path("saved.db");
  std::filesystem::copy_file(Out() + "/atlas.db", atlas);
  ASSERT_NO_FATAL_FAILURE(Run({"--data", Sequence(), "--speed", "lockstep", "--atlas", atlas}));
  EXPECT_EQ(Summary("maps"), 1);
  EXPECT_GE(Summary("tracked"), static_cast<int>(NumFrames()) - 20);
  ExpectAccurate(Truth(), Out() + "/trajectory.txt", kMaxErrorShare);
}

/// None of its maps is in memory until the camera is found in it, and sees the next.
TEST_F(MapsTest, MapsThatArePagedAreComeBackTo) {
  ASSERT_NO_FATAL_FAILURE(Run({"--data", Sequence(), "--speed", "lockstep", "--set", "tracker.max_map_keyframes=6"}));
  const int maps = Summary("maps");
  ASSERT_GE(maps, 2);
  const std::string atlas = folder_.Path("saved.db");
  std::filesystem::copy_file(Out() + "/atlas.db", atlas);
  ASSERT_NO_FATAL_FAILURE(Run({"--data", Sequence(), "--speed", "lockstep", "--atlas", atlas, "--set",
                               "atlas.maps_mb=0", "--set", "atlas.switch_keyframes=4"}));
  const nlohmann::json report = Report("atlas_server");
  EXPECT_GE(report["paging"]["loads"], 2) << "of the first, and of one that it was left for";
  EXPECT_EQ(report["paging"]["load_failures"], 0);
  EXPECT_GE(report["overlaps"]["located"], 1);
  EXPECT_GE(report["switches"], 1);
  EXPECT_EQ(report["maps"], maps);
  EXPECT_EQ(report["map_hash"].size(), static_cast<size_t>(maps)) << "those that are paged too";
  EXPECT_EQ(report["stored_keyframes"], report["keyframes"]);
  EXPECT_GE(Summary("tracked"), static_cast<int>(NumFrames()) - 20);
  ExpectAccurate(Truth(), Out() + "/trajectory.txt", kMaxErrorShare);
}

}  // namespace
}  // namespace portolan
