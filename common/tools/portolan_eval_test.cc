#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>
#include <string>

#include "base/flat_yaml.h"
#include "dataset/temp_folder.h"
#include "dataset/transformed_trajectory.h"
#include "tools/run_tool.h"

namespace portolan {
namespace {

using nlohmann::json;
using testing::HasSubstr;
using testing::Not;

constexpr int kPoses = 12;          // ten a second, three times around
constexpr double kOffset = 0.1;     // of the estimate, out of the plane
constexpr double kRounding = 1e-7;  // files have nine decimals

/// Around the corners of a rectangle of 8 by 6 without turning, from pose `first` on. `offset` lifts every second
/// corner out of the plane and lowers the others, which neither a rotation nor a translation makes good in part.
Trajectory Corners(int first, int size, double offset) {
  Trajectory trajectory;
  for (int i = first; i < first + size; ++i) {
    const Eigen::Vector3d corner(i % 4 == 0 || i % 4 == 3 ? 4 : -4, i % 4 < 2 ? 3 : -3, i % 2 == 0 ? offset : -offset);
    trajectory.push_back({Timestamp{i * 100000000LL}, Rigid3d(Eigen::Quaterniond::Identity(), corner), 0});
  }
  return trajectory;
}

Sim3d SomeSim3(double scale) {
  return Sim3d(scale, ExpSO3({0.5, -1, 2}), {7, -3, 1});
}

class EvalTool : public testing::Test {
 protected:
  EvalTool() {
    Write("truth.txt", Corners(0, kPoses, 0));
    Write("estimate.txt", Transformed(Corners(0, kPoses, kOffset), SomeSim3(0.3)));
  }
  void Write(const std::string& name, const Trajectory& trajectory, bool with_map = false) {
    ASSERT_TRUE(WriteTrajectory(folder_.Path(name), trajectory, with_map));
  }
  Outcome Run(const std::string& arguments) { return RunProgram(PORTOLAN_TOOL, arguments); }
  std::string Files() const { return folder_.Path("truth.txt") + " " + folder_.Path("estimate.txt") + " "; }
  /// The figures of a run that must go well.
  json FiguresOf(const std::string& arguments) {
    const Outcome outcome = Run(arguments + " --json " + folder_.Path("figures.json"));
    EXPECT_EQ(outcome.exit_code, 0) << outcome.output;
    const Result<std::string> text = ReadTextFile(folder_.Path("figures.json"));
    return text ? json::parse(*text) : json();
  }
  std::string PlotOf(const std::string& arguments) {
    const Outcome outcome = Run(Files() + arguments + " --plot " + folder_.Path("plot.svg"));
    EXPECT_EQ(outcome.exit_code, 0) << outcome.output;
    return ReadTextFile(folder_.Path("plot.svg")).value();
  }
  void ExpectFailure(const std::string& arguments, int exit_code, const std::string& reason) {
    const Outcome outcome = Run(arguments);
    EXPECT_EQ(outcome.exit_code, exit_code) << arguments << "\n" << outcome.output;
    EXPECT_THAT(outcome.output, HasSubstr(reason)) << arguments;
  }
  const TempFolder folder_;
};

TEST_F(EvalTool, ASimilarTrajectoryHasNoErrorAndTheScaleIsTold) {
  Write("estimate.txt", Transformed(Corners(0, kPoses, 0), SomeSim3(0.3)));
  const json figures = FiguresOf(Files());
  EXPECT_NEAR(figures["joined"]["ate"]["rmse"], 0, kRounding);
  EXPECT_NEAR(figures["joined"]["scale"], 1 / 0.3, kRounding);
  EXPECT_EQ(figures["frames"], kPoses);
  EXPECT_EQ(figures["tracked"], kPoses);
  EXPECT_EQ(figures["coverage"], 1);
  EXPECT_NEAR(figures["max_dt"], 0.05, 1e-5) << "half the interval";
  EXPECT_EQ(figures["joined"]["matched"], kPoses);
  EXPECT_EQ(figures["maps"].size(), 1u);
  EXPECT_THAT(Run(Files()).output, HasSubstr("frames 12, tracked 12, coverage 100.0 %, matched 12 within"));
}

/// With x of squared norm 25 and offsets of squared norm o = 0.01 at right angles to it, the best scale for x + offset
/// is 25 / (25 + o), and the mean square of what remains is 25 o / (25 + o).
TEST_F(EvalTool, AKnownOffsetIsTheError) {
  const double left = 25 + kOffset * kOffset;
  const json free_scale = FiguresOf(Files());
  EXPECT_NEAR(free_scale["joined"]["ate"]["rmse"], kOffset * std::sqrt(25 / left), kRounding);
  EXPECT_NEAR(free_scale["joined"]["scale"], 25 / left / 0.3, kRounding);
  Write("estimate.txt", Transformed(Corners(0, kPoses, kOffset), SomeSim3(1)));
  const json fixed_scale = FiguresOf(Files() + "--scale fixed");
  EXPECT_NEAR(fixed_scale["joined"]["ate"]["rmse"], kOffset, kRounding);
  EXPECT_NEAR(fixed_scale["joined"]["ate"]["max"], kOffset, kRounding);
  EXPECT_EQ(fixed_scale["joined"]["scale"], 1);
  EXPECT_EQ(fixed_scale["maps_combined"], fixed_scale["joined"]["ate"]);
}

/// From one pose to the next the offset changes by twice its size, to the one after it not at all.
TEST_F(EvalTool, TheRelativeErrorIsOverTheIntervalAskedFor) {
  Write("estimate.txt", Transformed(Corners(0, kPoses, kOffset), SomeSim3(1)));
  const auto expect_rpe = [&](const std::string& delta, double rmse, int count) {
    const json figures = FiguresOf(Files() + "--scale fixed --rpe-delta " + delta);
    EXPECT_NEAR(figures["rpe_translation"]["rmse"], rmse, kRounding) << delta;
    EXPECT_EQ(figures["rpe_translation"]["count"], count) << delta;
    EXPECT_LT(figures["rpe_rotation_deg"]["max"], 1e-5) << delta;
  };
  expect_rpe("1", 2 * kOffset, kPoses - 1);
  expect_rpe("2frames", 0, kPoses - 2);
  expect_rpe("0.3s", 2 * kOffset, kPoses - 3);
  expect_rpe("1s", 0, kPoses - 10);
  EXPECT_THAT(Run(Files() + "--rpe-delta 2").output, HasSubstr("RPE 2 frames"));
  EXPECT_THAT(Run(Files()).output, HasSubstr("RPE 1s"));
}

TEST_F(EvalTool, TheFramesAreThoseNamedOrBesideTheGroundTruth) {
  EXPECT_EQ(FiguresOf(Files() + "--frames 24")["frames"], 24);
  EXPECT_EQ(FiguresOf(Files() + "--frames 24")["coverage"], 0.5);
  const std::string list = folder_.Write("list.txt", "0.0\n0.2\n0.4\n0.6\n5.0\n");
  const json listed = FiguresOf(Files() + "--frames " + list);
  EXPECT_EQ(listed["frames"], 5);
  EXPECT_EQ(listed["tracked"], 4);
  EXPECT_EQ(listed["joined"]["matched"], 4);
  folder_.Write("rgb.txt", "# seconds file\n0.0 a.png\n0.1 b.png\n0.3 c.png\n");
  EXPECT_EQ(FiguresOf(Files())["frames"], 3) << "the camera's list beside the ground truth";
}

TEST_F(EvalTool, ASpanIsInSecondsOrFrames) {
  for (const char* span : {"--from 0.4 --to 0.7", "--first-frame 4 --last-frame 7", "--first-frame 4 --to 0.7"}) {
    const json figures = FiguresOf(Files() + span);
    EXPECT_EQ(figures["frames"], 4) << span;
    EXPECT_EQ(figures["joined"]["matched"], 4) << span;
  }
  ExpectFailure(Files() + "--first-frame 12", 1, "--first-frame 12: there are 12 frames");
  ExpectFailure(Files() + "--last-frame 99", 1, "--last-frame 99: there are 12 frames");
  ExpectFailure(Files() + "--from 5", 1, "no estimated pose within");
}

TEST_F(EvalTool, EveryMapIsAlignedByItself) {
  Trajectory estimate = Transformed(Corners(0, 6, 0), SomeSim3(0.3), 3);
  for (const TrajectoryPose& pose : Transformed(Corners(6, 6, 0), Sim3d(2, ExpSO3({1, 0, 0}), {0, 50, 0}), 7)) {
    estimate.push_back(pose);
  }
  Write("estimate.txt", estimate, true);
  const json figures = FiguresOf(Files());
  ASSERT_EQ(figures["maps"].size(), 2u);
  EXPECT_EQ(figures["maps"][0]["map"], 3);
  EXPECT_EQ(figures["maps"][1]["map"], 7);
  EXPECT_NEAR(figures["maps"][0]["scale"], 1 / 0.3, kRounding);
  EXPECT_NEAR(figures["maps"][1]["scale"], 0.5, kRounding);
  EXPECT_NEAR(figures["maps_combined"]["rmse"], 0, kRounding);
  EXPECT_EQ(figures["maps_combined"]["count"], kPoses);
  EXPECT_GT(figures["joined"]["ate"]["rmse"], 1) << "as one trajectory they don't fit";
  EXPECT_THAT(Run(Files()).output, HasSubstr("ATE of map 7"));
  EXPECT_THAT(PlotOf(""), Not(HasSubstr("6 poses, ATE")));
  EXPECT_THAT(PlotOf("--per-map"), HasSubstr("6 poses, ATE"));
}

TEST_F(EvalTool, PlotsByTheNamesEnd) {
  EXPECT_THAT(PlotOf(""), HasSubstr("estimate.txt</text>")) << "its title";
  ASSERT_EQ(Run(Files() + "--plot " + folder_.Path("plot.png")).exit_code, 0);
  EXPECT_FALSE(cv::imread(folder_.Path("plot.png")).empty());
  ExpectFailure(Files() + "--plot " + folder_.Path("missing/plot.svg"), 1, "missing/plot.svg");
}

TEST_F(EvalTool, MarksLoopClosuresInThePlot) {
  const std::string closures =
      folder_.Write("closures.json", R"({"closures": [{"stamp_ns": 1100000000, "matched_stamp_ns": 300000000}]})");
  EXPECT_THAT(PlotOf("--closures " + closures), HasSubstr("loop closures"));
  EXPECT_THAT(PlotOf(""), Not(HasSubstr("loop closures")));
  const std::string plot = "--plot " + folder_.Path("plot.svg") + " --closures ";
  const std::string bad = folder_.Write("bad.json", R"({"closures": [{"stamp_ns": "late"}]})");
  ExpectFailure(Files() + plot + bad, 1, bad + ": closures[0].stamp_ns: \"late\", expected integer nanoseconds");
  ExpectFailure(Files() + plot + folder_.Path("none.json"), 1, "none.json: can't be opened");
  ExpectFailure(Files() + "--closures " + closures, 2, "--plot");
}

TEST_F(EvalTool, ReadsKittiPosesAtTheirTimes) {
  const std::string poses = folder_.Write("kitti/poses.txt",
                                          "1 0 0 4 0 1 0 3 0 0 1 0\n1 0 0 -4 0 1 0 3 0 0 1 0\n"
                                          "1 0 0 -4 0 1 0 -3 0 0 1 0\n1 0 0 4 0 1 0 -3 0 0 1 0\n");
  const std::string times = folder_.Write("elsewhere.txt", "0.4\n0.5\n0.6\n0.7\n");
  const std::string files = poses + " " + folder_.Path("estimate.txt") + " ";
  EXPECT_EQ(FiguresOf(files + "--times " + times)["joined"]["matched"], 4);
  folder_.Write("kitti/times.txt", "0.4\n0.5\n0.6\n5\n");
  EXPECT_EQ(FiguresOf(files)["joined"]["matched"], 3) << "times.txt beside the poses";
  folder_.Write("kitti/times.txt", "0.4\n0.5\n");
  ExpectFailure(files, 1, folder_.Path("kitti/times.txt") + ": has 2 times for the 4 poses of " + poses);
}

TEST_F(EvalTool, NamesTheFileAndLineThatIsBad) {
  const std::string truth = folder_.Path("truth.txt"), estimate = folder_.Path("estimate.txt");
  const std::string none = folder_.Path("none.txt");
  ExpectFailure(none + " " + estimate, 1, "portolan_eval: " + none + ": can't be opened");
  ExpectFailure(truth + " " + none, 1, "portolan_eval: " + none + ": can't be opened");
  const std::string bad = folder_.Write("bad.txt", "# stamp\n0 0 0 0 0 0 0 1\n0.1 0 0 zero 0 0 0 1\n");
  ExpectFailure(truth + " " + bad, 1, bad + ":3: expected 'seconds tx ty tz qx qy qz qw [map]'");
  ExpectFailure(bad + " " + estimate, 1, bad + ":3: expected");
  const std::string list = folder_.Write("list.txt", "0.0\n0.2\n0.1\n");
  ExpectFailure(Files() + "--frames " + list, 1, list + ":3: expected rising times in seconds, found '0.1'");
  ExpectFailure(Files() + "--frames " + none, 1, none + ": can't be opened");
  const std::string empty = folder_.Write("empty.txt", "# nothing\n");
  ExpectFailure(truth + " " + empty, 1, "the estimate no poses");
  ExpectFailure(Files() + "--json " + folder_.Path("missing/figures.json"), 1, "missing/figures.json");
}

TEST_F(EvalTool, BadArgumentsExitWithTwo) {
  ExpectFailure("", 2, "groundtruth");
  ExpectFailure(folder_.Path("truth.txt"), 2, "trajectory");
  ExpectFailure(Files() + "--unknown", 2, "--unknown");
  ExpectFailure(Files() + "--scale loose", 2, "loose");
  ExpectFailure(Files() + "--max-dt 0", 2, "--max-dt");
  for (const char* delta : {"five", "0", "-1s", "1m", "1.5", "0s"}) {
    ExpectFailure(Files() + "--rpe-delta=" + delta, 2, std::string("--rpe-delta ") + delta + ": expected seconds");
  }
  ExpectFailure(Files() + "--from noon", 2, "--from noon: expected seconds");
  ExpectFailure(Files() + "--to noon", 2, "--to noon: expected seconds");
  ExpectFailure(Files() + "--from 0 --first-frame 0", 2, "excludes");
  ExpectFailure(Files() + "--to 1 --last-frame 1", 2, "excludes");
  ExpectFailure(Files() + "--first-frame x", 2, "--first-frame");
  ExpectFailure(Files() + "--frames 0", 2, "--frames 0: expected 1 or more");
  ExpectFailure(Files() + "--plot plot.pdf", 2, "--plot plot.pdf: expected a name that ends in .svg or .png");
}

TEST_F(EvalTool, HelpAndVersionAreNoErrors) {
  const Outcome help = Run("--help");
  EXPECT_EQ(help.exit_code, 0);
  EXPECT_THAT(help.output, HasSubstr("--rpe-delta"));
  const Outcome version = Run("--version");
  EXPECT_EQ(version.exit_code, 0);
  EXPECT_THAT(version.output, HasSubstr("portolan_eval "));
}

}  // namespace
}  // namespace portolan
