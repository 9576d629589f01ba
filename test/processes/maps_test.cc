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

}  // namespace
}  // namespace portolan
