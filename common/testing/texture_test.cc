#include "testing/texture.h"

#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>

#include "base/check.h"
#include "testing/texture_painter.h"

namespace portolan {
namespace {

constexpr int kSide = 64;

cv::Mat Ramp() {
  cv::Mat picture(kSide, kSide, CV_8UC1);
  for (int y = 0; y < kSide; ++y) {
    for (int x = 0; x < kSide; ++x) picture.at<uint8_t>(y, x) = static_cast<uint8_t>(2 * x + y);
  }
  return picture;
}

TEST(Texture, HasItsTexelsValuesAtTheirCentres) {
  const cv::Mat picture = Ramp();
  const Texture texture(picture);
  for (int y = 0; y < kSide; y += 7) {
    for (int x = 0; x < kSide; x += 5) {
      EXPECT_FLOAT_EQ(texture.Sample((x + 0.5) / kSide, (y + 0.5) / kSide, 0), picture.at<uint8_t>(y, x));
    }
  }
}

TEST(Texture, IsLinearBetweenTexels) {
  const Texture texture(Ramp());
  EXPECT_NEAR(texture.Sample(10.75 / kSide, 20.9 / kSide, 0), 2 * 10.25 + 20.4, 1e-3);
}

TEST(Texture, CoarserLevelsAreMeans) {
  const Texture texture(Ramp());
  // A level-1 texel covers texels 8, 9 across and 4, 5 down.
  EXPECT_FLOAT_EQ(texture.Sample(9.0 / kSide, 5.0 / kSide, 1), 22);  // 2 * 8.5 + 4.5 = 21.5, rounded
  const double mean = cv::mean(Ramp())[0];
  EXPECT_NEAR(texture.Sample(0.3, 0.8, 100), mean, 1.0);
}

TEST(Texture, RepeatsInBothDirections) {
  const Texture texture(Ramp());
  for (const double u : {0.01, 0.37, 0.995}) {
    for (const double v : {0.003, 0.5, 0.93}) {
      EXPECT_NEAR(texture.Sample(u, v, 0.5f), texture.Sample(u - 3, v + 2, 0.5f), 1e-3);
    }
  }
}

TEST(Texture, RefusesSidesThatAreNoPowersOfTwo) {
  EXPECT_THROW(Texture(cv::Mat::zeros(64, 48, CV_8UC1)), CheckFailure);
  EXPECT_THROW(Texture(cv::Mat::zeros(64, 64, CV_8UC3)), CheckFailure);
}

/// A picture's structure at a size, without its brightness: for telling whether pictures look alike.
double Correlation(const cv::Mat& a, const cv::Mat& b) {
  cv::Mat result;
  cv::matchTemplate(a, b, result, cv::TM_CCOEFF_NORMED);
  return result.at<float>(0, 0);
}

TEST(TexturePainter, SameSeedSamePictureOtherSeedAnother) {
  for (uint64_t seed = 1; seed < 6; ++seed) {
    Random a(seed), b(seed), c(seed + 100);
    const cv::Mat facade = PaintFacade(256, 4, &a);
    EXPECT_EQ(cv::norm(facade, PaintFacade(256, 4, &b), cv::NORM_INF), 0);
    EXPECT_LT(Correlation(facade, PaintFacade(256, 4, &c)), 0.7);
  }
}

TEST(TexturePainter, AllPaintersFillTheirPictureWithContrast) {
  Random random(5);
  const std::vector<cv::Mat> pictures = {PaintBricks(256, 20, 120, &random), PaintCobbles(256, 16, &random),
                                         PaintPavement(256, 8, &random),     PaintPlanks(256, 12, &random),
                                         PaintPoster({256, 256}, &random),   PaintBookshelf(256, 4, &random),
                                         PaintFacade(256, 4, &random),       PaintRoomWall({512, 256}, &random)};
  for (const cv::Mat& picture : pictures) {
    ASSERT_EQ(picture.type(), CV_8UC1);
    cv::Scalar mean, deviation;
    cv::meanStdDev(picture, mean, deviation);
    EXPECT_GT(deviation[0], 8);
    EXPECT_GT(mean[0], 30);
    EXPECT_LT(mean[0], 225);
  }
}

}  // namespace
}  // namespace portolan
