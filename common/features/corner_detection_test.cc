#include "features/corner_detection.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <opencv2/features2d.hpp>

#include "features/test_images.h"

namespace portolan {
namespace {

constexpr int kThreshold = 20, kMinThreshold = 7, kCellPx = 35, kBorderPx = 19;

CornerDetector MakeDetector() {
  return CornerDetector(kThreshold, kMinThreshold, kCellPx, kBorderPx);
}

TEST(CornerDetector, FindsNothingOnFlatOrTinyImages) {
  CornerDetector detector = MakeDetector();
  EXPECT_TRUE(detector.Detect(cv::Mat(200, 300, CV_8UC1, cv::Scalar(90))).empty());
  EXPECT_TRUE(detector.Detect(TexturedImage(2 * kBorderPx, 100, 1)).empty());
  EXPECT_TRUE(detector.Detect(TexturedImage(100, 3, 1)).empty());
}

TEST(CornerDetector, KeepsTheBorderFree) {
  const cv::Mat image = TexturedImage(320, 240, 2);
  CornerDetector detector = MakeDetector();
  const std::vector<Corner> corners = detector.Detect(image);
  ASSERT_GT(corners.size(), 200u);
  for (const Corner& corner : corners) {
    EXPECT_TRUE(
        cv::Rect(kBorderPx, kBorderPx, 320 - 2 * kBorderPx, 240 - 2 * kBorderPx).contains({corner.x, corner.y}));
  }
}

TEST(CornerDetector, AgreesWithOpenCvWhereEveryCellHasCorners) {
  const cv::Mat image = TexturedImage(320, 240, 3);
  CornerDetector detector = MakeDetector();
  std::vector<cv::KeyPoint> expected;
  cv::FAST(image, expected, kThreshold, true);
  const cv::Rect inside(kBorderPx + 1, kBorderPx + 1, 320 - 2 * kBorderPx - 2,
                        240 - 2 * kBorderPx - 2);  // suppression sees less at the rim
  size_t num_inside = 0;
  const std::vector<Corner>& corners = detector.Detect(image);
  for (const cv::KeyPoint& keypoint : expected) {
    if (!inside.contains(keypoint.pt)) continue;
    ++num_inside;
    EXPECT_TRUE(std::any_of(corners.begin(), corners.end(), [&](const Corner& corner) {
      return corner.x == keypoint.pt.x && corner.y == keypoint.pt.y && corner.score == keypoint.response;
    })) << keypoint.pt;
  }
  EXPECT_GT(num_inside, 200u);
}

TEST(CornerDetector, SearchesEmptyCellsAtTheLowThreshold) {
  cv::Mat image(240, 320, CV_8UC1, cv::Scalar(100));
  const std::vector<cv::Point> triangle = {{200, 150}, {225, 157}, {208, 175}};
  cv::fillConvexPoly(image, triangle, cv::Scalar(114));  // too faint for the high threshold
  cv::GaussianBlur(image, image, cv::Size(5, 5), 1);
  CornerDetector detector = MakeDetector();
  const std::vector<Corner>& corners = detector.Detect(image);
  EXPECT_GE(corners.size(), 1u);
  for (const Corner& corner : corners) EXPECT_LT(corner.score, kThreshold);
  CornerDetector only_high(kThreshold, kThreshold, kCellPx, kBorderPx);
  EXPECT_TRUE(only_high.Detect(image).empty());
}

TEST(CornerDetector, FindsNoPixelTwice) {
  cv::Mat image = TexturedImage(320, 240, 4);
  image(cv::Rect(0, 0, 160, 240)) =
      image(cv::Rect(0, 0, 160, 240)) / 16 + 100;  // a faint half: both thresholds at work
  CornerDetector detector = MakeDetector();
  std::vector<std::pair<int, int>> pixels;
  for (const Corner& corner : detector.Detect(image)) pixels.emplace_back(corner.x, corner.y);
  std::sort(pixels.begin(), pixels.end());
  EXPECT_EQ(std::adjacent_find(pixels.begin(), pixels.end()), pixels.end());
  EXPECT_TRUE(std::any_of(pixels.begin(), pixels.end(), [](const auto& pixel) { return pixel.first < 140; }));
}

}  // namespace
}  // namespace portolan
