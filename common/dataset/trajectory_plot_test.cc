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
  const std::string svg = DrawTrajectories(MakeEvaluation(1), {"run <1>", false}).ToSvg();
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
  const std::string svg = DrawTrajectories(MakeEvaluation(2), {"", true}).ToSvg();
  EXPECT_THAT(svg, HasSubstr("map 0"));
  EXPECT_THAT(svg, HasSubstr("map 1"));
  EXPECT_EQ(Count(svg, "stroke=\"#0072b2\""), 2u);
  EXPECT_EQ(Count(svg, "stroke=\"#d55e00\""), 2u);
  EXPECT_THAT(svg, HasSubstr("ATE of maps combined"));
}

TEST(TrajectoryPlotTest, AMapWithoutAlignmentIsNamedAndNotDrawn) {
  Evaluation evaluation = MakeEvaluation(2);
  evaluation.maps[1].truth_from_map.reset();
  const std::string svg = DrawTrajectories(evaluation, {"", true}).ToSvg();
  EXPECT_THAT(svg, HasSubstr("not aligned"));
  EXPECT_EQ(Count(svg, "stroke=\"#d55e00\""), 1u) << "the legend's sample";
}

TEST(TrajectoryPlotTest, SurvivesACameraThatStandsStill) {
  Evaluation evaluation;
  for (int i = 0; i < 5; ++i) evaluation.truth.push_back({Timestamp{i * 1000000000LL}, Rigid3d(), 0});
  evaluation.joined.failure = "no extent";
  EXPECT_THAT(DrawTrajectories(evaluation, {}).ToSvg(), Not(HasSubstr("nan")));
}

TEST(TrajectoryPlotTest, WritesBothKindsByTheNamesEnd) {
  const TempFolder folder;
  const PlotCanvas canvas = DrawTrajectories(MakeEvaluation(1), {"run", false});
  ASSERT_TRUE(canvas.Write(folder.Path("p.png")));
  const cv::Mat picture = cv::imread(folder.Path("p.png"));
  ASSERT_FALSE(picture.empty());
  int blue = 0;
  for (int y = 0; y < picture.rows; ++y) {
    for (int x = 0; x < picture.cols; ++x) blue += picture.at<cv::Vec3b>(y, x) == cv::Vec3b(178, 114, 0);
  }
  EXPECT_GT(blue, 500) << "pixels of the estimate's colour";
  ASSERT_TRUE(canvas.Write(folder.Path("p.svg")));
  EXPECT_THAT(*ReadTextFile(folder.Path("p.svg")), HasSubstr("</svg>"));
  EXPECT_THAT(canvas.Write(folder.Path("p.pdf")).error().message, HasSubstr("must end in .svg or .png"));
}

}  // namespace
}  // namespace portolan
