#include "dataset/trajectory_plot.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <string>

#include "base/flat_yaml.h"
#include "dataset/temp_folder.h"

namespace portolan {
namespace {

using testing::HasSubstr;
using testing::Not;

/// An arc in the plane y = 2 with a gap in time of the estimate between poses 40 and 60.
Evaluation MakeEvaluation(int num_maps) {
  Trajectory truth;
  Trajectory estimate;
  for (int i = 0; i < 100; ++i) {
    const Eigen::Vector3d position(10 * std::cos(0.02 * i), 2, 10 * std::sin(0.02 * i));
    truth.push_back({Timestamp{i * 100000000LL}, Rigid3d(Eigen::Quaterniond::Identity(), position), 0});
    if (i < 40 || i > 60) estimate.push_back(truth.back());
    if (i > 60 && num_maps > 1) estimate.back().map = 1;
  }
  return *EvaluateTrajectory(truth, estimate, {});
}

size_t Count(const std::string& text, const std::string& part) {
  size_t count = 0;
  for (size_t at = text.find(part); at != std::string::npos; at = text.find(part, at + 1)) ++count;
  return count;
}

TEST(TrajectoryPlotTest, DrawsTheTruthAndTheEstimateWithItsGap) {
  const std::string svg = DrawTrajectories(MakeEvaluation(1), {"run <1>", false, {}}).ToSvg();
  EXPECT_THAT(svg, HasSubstr("run &lt;1&gt;"));
  EXPECT_THAT(svg, HasSubstr("ground truth"));
  EXPECT_THAT(svg, HasSubstr("estimate"));
  EXPECT_THAT(svg, HasSubstr("ATE "));
  EXPECT_EQ(Count(svg, "stroke=\"#0072b2\""), 3u) << "two pieces of the path and the legend's sample";
  EXPECT_THAT(svg, Not(HasSubstr("nan")));
}

TEST(TrajectoryPlotTest, TakesTheTwoAxesOfLargestExtent) {
  const std::string svg = DrawTrajectories(MakeEvaluation(1), {}).ToSvg();
  EXPECT_THAT(svg, HasSubstr(">x</text>"));
  EXPECT_THAT(svg, HasSubstr(">z</text>"));
  EXPECT_THAT(svg, Not(HasSubstr(">y</text>")));
}

TEST(TrajectoryPlotTest, EveryMapHasItsColourAndItsRow) {
  const std::string svg = DrawTrajectories(MakeEvaluation(2), {"", true, {}}).ToSvg();
  EXPECT_THAT(svg, HasSubstr("map 0"));
  EXPECT_THAT(svg, HasSubstr("map 1"));
  EXPECT_EQ(Count(svg, "stroke=\"#0072b2\""), 2u);
  EXPECT_EQ(Count(svg, "stroke=\"#d55e00\""), 2u);
  EXPECT_THAT(svg, HasSubstr("ATE of maps combined"));
}

TEST(TrajectoryPlotTest, AMapWithoutAlignmentIsNamedAndNotDrawn) {
  Evaluation evaluation = MakeEvaluation(2);
  evaluation.maps[1].truth_from_map.reset();
  const std::string svg = DrawTrajectories(evaluation, {"", true, {}}).ToSvg();
  EXPECT_THAT(svg, HasSubstr("not aligned"));
  EXPECT_EQ(Count(svg, "stroke=\"#d55e00\""), 1u) << "the legend's sample";
}

/// Of the arc's poses by their number.
LoopClosure ClosureOf(int pose, int matched_pose) {
  return {Timestamp{pose * 100000000LL}, Timestamp{matched_pose * 100000000LL}};
}

TEST(TrajectoryPlotTest, AClosureIsALineBetweenItsTwoPlaces) {
  TrajectoryPlotOptions options;
  options.closures = {ClosureOf(99, 0), ClosureOf(90, 10)};
  const std::string svg = DrawTrajectories(MakeEvaluation(1), options).ToSvg();
  const std::string plain = DrawTrajectories(MakeEvaluation(1), {}).ToSvg();
  EXPECT_THAT(svg, HasSubstr("loop closures"));
  EXPECT_THAT(svg, HasSubstr(">2</text>"));
  EXPECT_EQ(Count(svg, "stroke=\"#c8003c\""), 3u) << "two closures and the legend's sample";
  EXPECT_EQ(Count(svg, "fill=\"#c8003c\""), 6u) << "a dot at each end";
  EXPECT_THAT(plain, Not(HasSubstr("closures")));
  // The first closure's line goes from the start of the estimate's line to its end.
  const auto points_of = [&](const std::string& color, size_t which) {
    size_t at = 0;
    for (size_t i = 0; i <= which; ++i) at = svg.find("stroke=\"" + color + "\"", at + 1);
    const size_t begin = svg.find("points=\"", at) + 8;
    return svg.substr(begin, svg.find(" \"", begin) - begin);
  };
  const std::string first_piece = points_of("#0072b2", 0), last_piece = points_of("#0072b2", 1);
  const std::string start = first_piece.substr(0, first_piece.find(' '));
  const std::string end = last_piece.substr(last_piece.rfind(' ') + 1);
  EXPECT_EQ(points_of("#c8003c", 0), start + " " + end);
}

TEST(TrajectoryPlotTest, AClosureFollowsTheAlignmentOfItsMap) {
  Evaluation evaluation = MakeEvaluation(2);
  TrajectoryPlotOptions options;
  options.closures = {ClosureOf(99, 0)};
  EXPECT_EQ(Count(DrawTrajectories(evaluation, options).ToSvg(), "stroke=\"#c8003c\""), 2u);
  options.per_map = true;
  EXPECT_EQ(Count(DrawTrajectories(evaluation, options).ToSvg(), "stroke=\"#c8003c\""), 2u);
  evaluation.maps[1].truth_from_map.reset();
  EXPECT_EQ(Count(DrawTrajectories(evaluation, options).ToSvg(), "stroke=\"#c8003c\""), 1u);
}

TEST(TrajectoryPlotTest, AClosureWithoutAPoseIsCountedAndNotDrawn) {
  TrajectoryPlotOptions options;
  options.closures = {ClosureOf(50, 0), ClosureOf(99, 1000), ClosureOf(99, 5)};  // 50: in the gap
  const std::string svg = DrawTrajectories(MakeEvaluation(1), options).ToSvg();
  EXPECT_THAT(svg, HasSubstr(">3, 2 without a pose</text>"));
  EXPECT_EQ(Count(svg, "stroke=\"#c8003c\""), 2u);
  options.closures->clear();
  EXPECT_THAT(DrawTrajectories(MakeEvaluation(1), options).ToSvg(), HasSubstr(">0</text>"));
}

TEST(TrajectoryPlotTest, SurvivesACameraThatStandsStill) {
  Evaluation evaluation;
  for (int i = 0; i < 5; ++i) evaluation.truth.push_back({Timestamp{i * 1000000000LL}, Rigid3d(), 0});
  evaluation.joined.failure = "no extent";
  EXPECT_THAT(DrawTrajectories(evaluation, {}).ToSvg(), Not(HasSubstr("nan")));
}

TEST(TrajectoryPlotTest, WritesBothKindsByTheNamesEnd) {
  const TempFolder folder;
  const PlotCanvas canvas = DrawTrajectories(MakeEvaluation(1), {"run", false, {{ClosureOf(99, 0)}}});
  ASSERT_TRUE(canvas.Write(folder.Path("p.png")));
  const cv::Mat picture = cv::imread(folder.Path("p.png"));
  ASSERT_FALSE(picture.empty());
  int blue = 0, red = 0;
  for (int y = 0; y < picture.rows; ++y) {
    for (int x = 0; x < picture.cols; ++x) {
      blue += picture.at<cv::Vec3b>(y, x) == cv::Vec3b(178, 114, 0);
      red += picture.at<cv::Vec3b>(y, x) == cv::Vec3b(60, 0, 200);
    }
  }
  EXPECT_GT(blue, 500) << "pixels of the estimate's colour";
  EXPECT_GT(red, 500) << "pixels of the closure's colour";
  ASSERT_TRUE(canvas.Write(folder.Path("p.svg")));
  EXPECT_THAT(*ReadTextFile(folder.Path("p.svg")), HasSubstr("</svg>"));
  EXPECT_THAT(canvas.Write(folder.Path("p.pdf")).error().message, HasSubstr("must end in .svg or .png"));
}

}  // namespace
}  // namespace portolan
