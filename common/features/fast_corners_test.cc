#include "features/fast_corners.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <opencv2/features2d.hpp>
#include <tuple>
#include <vector>

#include "features/test_images.h"

namespace portolan {
namespace {

using Found = std::vector<std::tuple<int, int, float>>;  // x, y, score

Found FindOurs(const cv::Mat& image, int threshold, FastCorners* fast) {
  std::vector<Corner> corners;
  fast->Find(image, threshold, &corners);
  Found found;
  for (const Corner& corner : corners) found.emplace_back(corner.x, corner.y, corner.score);
  return found;
}

Found FindWithOpenCv(const cv::Mat& image, int threshold) {
  std::vector<cv::KeyPoint> keypoints;
  cv::FAST(image, keypoints, threshold, true);
  Found found;
  for (const cv::KeyPoint& keypoint : keypoints)
    found.emplace_back(static_cast<int>(keypoint.pt.x), static_cast<int>(keypoint.pt.y), keypoint.response);
  return found;
}

cv::Mat Noise(int width, int height, int lowest, int highest, uint64_t seed) {
  Random random(seed);
  cv::Mat image(height, width, CV_8UC1);
  for (auto pixel = image.begin<uchar>(); pixel != image.end<uchar>(); ++pixel)
    *pixel = cv::saturate_cast<uchar>(random.Uniform(lowest, highest));
  return image;
}

TEST(FastCorners, AreThoseOfOpenCvInTheSameOrder) {
  FastCorners fast;  // one for all: what it keeps must not show
  size_t corners = 0;
  for (const int threshold : {1, 7, 20, 60, 254}) {
    for (const cv::Mat& image : {TexturedImage(322, 241, 1), Noise(200, 90, 0, 256, 2), Noise(131, 50, 100, 140, 3)}) {
      const Found expected = FindWithOpenCv(image, threshold);
      EXPECT_EQ(FindOurs(image, threshold, &fast), expected) << threshold;
      corners += expected.size();
    }
  }
  EXPECT_GT(corners, 5000u);
}

TEST(FastCorners, AreThoseOfOpenCvInImagesOfAnyWidth) {
  FastCorners fast;
  for (int width = 1; width <= 70; ++width) {
    const cv::Mat image = TexturedImage(width, 30, static_cast<uint64_t>(width));
    EXPECT_EQ(FindOurs(image, 10, &fast), FindWithOpenCv(image, 10)) << width;
  }
  for (int height = 1; height <= 12; ++height) {
    const cv::Mat image = Noise(60, height, 0, 256, static_cast<uint64_t>(height));
    EXPECT_EQ(FindOurs(image, 10, &fast), FindWithOpenCv(image, 10)) << height;
  }
}

TEST(FastCorners, OfAPartOfAnImageKnowNothingOfTheRest) {
  FastCorners fast;
  const cv::Mat image = TexturedImage(200, 120, 5);
  for (const cv::Rect& part : {cv::Rect(0, 0, 40, 40), cv::Rect(157, 77, 43, 43), cv::Rect(60, 30, 19, 80)}) {
    EXPECT_EQ(FindOurs(image(part), 15, &fast), FindWithOpenCv(image(part).clone(), 15)) << part;
  }
}

TEST(FastCorners, AreAppended) {
  std::vector<Corner> corners(1);
  FastCorners().Find(TexturedImage(100, 100, 6), 20, &corners);
  ASSERT_GT(corners.size(), 10u);
  EXPECT_EQ(corners[0].x, 0);
}

TEST(FastScore, AgreesWithTheCorners) {
  const cv::Mat image = TexturedImage(160, 120, 1);
  std::vector<Corner> corners;
  FastCorners().Find(image, 20, &corners);
  ASSERT_GT(corners.size(), 50u);
  for (const Corner& corner : corners) {
    const int score = std::max(FastScore(image, corner.x, corner.y, +1), FastScore(image, corner.x, corner.y, -1));
    EXPECT_EQ(score, corner.score + 1);  // a corner's contrast is above the threshold
  }
}

}  // namespace
}  // namespace portolan
