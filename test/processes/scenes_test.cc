// Places where two views tell little: a planar wall, which two motions explain, and a camera that only turns.

#include "processes/process_test.h"
#include "processes/run_output_check.h"

namespace portolan {
namespace {

using ScenesTest = ProcessTest;

TEST_F(ScenesTest, AWallIsMappedAsThePlaneThatItIs) {
  const Ended run = RunToEnd(RunCommand({"--data", Sequence("wall"), "--speed", "lockstep"}));
  ASSERT_EQ(run.code, 0) << run.output << Logs();
  EXPECT_EQ(Report("summary")["maps"], 1);
  // The camera must go on in another direction before its first frames can be understood; they are tracked afterwards.
  EXPECT_GT(Report("summary")["tracked"], 0.9 * Report("summary")["frames"].get<double>());
  ExpectAccurate(Sequence("wall") + "/groundtruth.txt", Out() + "/trajectory.txt", 0.005);
}

/// Sideways, then right and left without a baseline, then back.
TEST_F(ScenesTest, ATurnOnTheSpotLosesNothing) {
  const Ended run = RunToEnd(RunCommand({"--data", Sequence("rotation"), "--speed", "lockstep"}));
  ASSERT_EQ(run.code, 0) << run.output << Logs();
  EXPECT_EQ(Report("summary")["maps"], 1);
  EXPECT_GT(Report("summary")["tracked"], 0.95 * Report("summary")["frames"].get<double>());
}

}  // namespace
}  // namespace portolan
