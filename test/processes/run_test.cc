// Whole runs through run.sh: what they leave, on each vendor and across vendors, repeated, and in real time.

#include <map>

#include "processes/process_test.h"
#include "processes/run_output_check.h"

namespace portolan {
namespace {

/// Three times what a run leaves: 0.09 m on a way of 27 m.
constexpr double kMaxErrorShare = 0.01;
constexpr double kMinTrackedShare = 0.8;

class RunTest : public ProcessTest {
 protected:
  void ExpectGoodRun(const Ended& run) const {
    ASSERT_EQ(run.code, 0) << run.output << Logs();
    ExpectWholeOutput(Out());
    const nlohmann::json summary = Report("summary");
    EXPECT_EQ(summary["frames"], NumFrames());
    EXPECT_GT(summary["tracked"], kMinTrackedShare * static_cast<double>(NumFrames()));
    ExpectAccurate(Truth(), Out() + "/trajectory.txt", kMaxErrorShare);
    ExpectSameMaps(Report("atlas_server"), Report("loop_closer"));
  }
};

struct Vendors {
  const char* name;
  std::vector<std::string> arguments;
};

class VendorTest : public RunTest, public ::testing::WithParamInterface<Vendors> {};

TEST_P(VendorTest, LockstepRunLeavesAWholeResult) {
  std::vector<std::string> arguments = {"--data", Sequence(), "--speed", "lockstep"};
  arguments.insert(arguments.end(), GetParam().arguments.begin(), GetParam().arguments.end());
  const Ended run = RunToEnd(RunCommand(arguments));
  ExpectGoodRun(run);
  EXPECT_EQ(Report("summary")["dropped"], 0) << "lockstep waits for the tracker";
}

INSTANTIATE_TEST_SUITE_P(
    All, VendorTest,
    ::testing::Values(Vendors{"fastdds", {"--dds", "fastdds"}}, Vendors{"cyclonedds", {"--dds", "cyclonedds"}},
                      Vendors{"mapper_and_loop_on_cyclonedds",
                              {"--dds", "fastdds", "--dds-mapper", "cyclonedds", "--dds-loop", "cyclonedds"}},
                      Vendors{"frontend_and_atlas_on_cyclonedds",
                              {"--dds", "fastdds", "--dds-frontend", "cyclonedds", "--dds-atlas", "cyclonedds"}}),
    [](const auto& parameter) { return parameter.param.name; });

TEST_F(RunTest, TwoLockstepRunsGiveTheSameBytes) {
  const std::vector<std::string> files = {"trajectory.txt", "trajectory_maps.txt", "trajectory_online.txt",
                                          "keyframes.txt"};
  std::map<std::string, std::string> first;
  for (const char* vendor : {"fastdds", "cyclonedds"}) {
    const Ended run = RunToEnd(RunCommand({"--data", Sequence(), "--speed", "lockstep", "--dds", vendor}));
    ASSERT_EQ(run.code, 0) << run.output << Logs();
    for (const std::string& file : files) {
      const std::string text = ReadWholeFile(Out() + "/" + file);
      EXPECT_NE(text, "") << file;
      // Whole files would be lines too long for colcon.
      EXPECT_TRUE(text == first.try_emplace(file, text).first->second) << file << " on " << vendor;
    }
  }
}

TEST_F(RunTest, EveryProgramTellsWhatItWasBuiltFrom) {
  for (const char* program : {"portolan_frontend_tracker", "portolan_backend_mapper", "portolan_loop_closer",
                              "portolan_atlas_server", "portolan_vocabulary", "portolan_synth", "portolan_eval",
                              "portolan_play", "portolan_pipeline_run", "portolan_orb_time"}) {
    const Ended ended = RunToEnd({Program(program), "--version"});
    EXPECT_EQ(ended.code, 0) << program;
    // Programs of one installation may be of several commits: packages are built one by one.
    EXPECT_THAT(ended.output, ::testing::MatchesRegex(std::string(program) + " [0-9.]+ ([0-9a-f]+ )?[A-Za-z]+\n"));
  }
}

/// A busy machine, or a sanitizer, may make the tracker late: frames that passed meanwhile are counted as dropped.
TEST_F(RunTest, SlowRealTimeCountsEveryFrameOnce) {
  const Ended run = RunToEnd(RunCommand({"--data", Sequence(), "--speed", RealTimeSpeed(0.5)}));
  ASSERT_EQ(run.code, 0) << run.output << Logs();
  ExpectWholeOutput(Out());
  const nlohmann::json summary = Report("summary"), frontend = Report("frontend_tracker");
  const auto dropped = frontend["dropped"].get<uint64_t>(), seen = frontend["frame_ms"]["count"].get<uint64_t>();
  EXPECT_EQ(summary["dropped"], dropped);
  EXPECT_EQ(seen + dropped + frontend["unreadable"].get<uint64_t>(), NumFrames());
  EXPECT_EQ(summary["lost"].get<uint64_t>() + summary["tracked"].get<uint64_t>(), NumFrames());
  EXPECT_GT(summary["tracked"], kMinTrackedShare * static_cast<double>(seen));
  ExpectAccurate(Truth(), Out() + "/trajectory.txt", kMaxErrorShare);
}

}  // namespace
}  // namespace portolan
