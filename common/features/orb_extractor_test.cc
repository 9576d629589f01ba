#include "features/orb_extractor.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "features/test_images.h"

namespace portolan {
namespace {

using testing::HasSubstr;

bool AreEqual(const FeatureSet& a, const FeatureSet& b) {
  return a.pixels_px == b.pixels_px && a.octaves == b.octaves && a.angles_rad == b.angles_rad &&
         a.descriptors == b.descriptors;
}

OrbOptions SmallOptions() {
  OrbOptions options;
  options.num_features = 500;
  return options;
}

TEST(OrbOptions, CheckNamesTheKey) {
  const auto message = [](void (*change)(OrbOptions*)) {
    OrbOptions options;
    change(&options);
    const Status status = options.Check();
    return status.ok() ? std::string() : status.error().message;
  };
  EXPECT_EQ(message([](OrbOptions*) {}), "");
  EXPECT_THAT(message([](OrbOptions* o) { o->num_features = 0; }), HasSubstr("num_features"));
  EXPECT_THAT(message([](OrbOptions* o) { o->pyramid.levels = 0; }), HasSubstr("levels"));
  EXPECT_THAT(message([](OrbOptions* o) { o->pyramid.factor = NAN; }), HasSubstr("factor"));
  EXPECT_THAT(message([](OrbOptions* o) { o->fast_threshold = 300; }), HasSubstr("fast_threshold"));
  EXPECT_THAT(message([](OrbOptions* o) { o->min_fast_threshold = 21; }), HasSubstr("min_fast_threshold"));
  EXPECT_THAT(message([](OrbOptions* o) { o->cell_px = 1; }), HasSubstr("cell_px"));
  EXPECT_THAT(message([](OrbOptions* o) { o->threads = 0; }), HasSubstr("threads"));
  EXPECT_THROW(OrbExtractor([] {
                 OrbOptions options;
                 options.cell_px = 0;
                 return options;
               }()),
               CheckFailure);
}

TEST(OrbExtractor, FindsTheNumberAskedForOnAllLevels) {
  const cv::Mat image = TexturedImage(640, 480, 1);
  OrbExtractor extractor((OrbOptions()));
  const FeatureSet features = extractor.Extract(image, PlainCamera(image));
  EXPECT_EQ(features.size(), 2000u);
  EXPECT_EQ(features.octaves.size(), features.size());
  EXPECT_EQ(features.angles_rad.size(), features.size());
  EXPECT_EQ(features.descriptors.size(), features.size());
  for (int octave = 0; octave < 7; ++octave) {  // each level has 1 / 1.44 of the features of the one below
    const auto on = [&](int o) { return std::count(features.octaves.begin(), features.octaves.end(), o); };
    EXPECT_NEAR(static_cast<double>(on(octave + 1)) / static_cast<double>(on(octave)), 1 / 1.44, 0.03);
  }
}

TEST(OrbExtractor, IsDeterministicWhateverItSawBefore) {
  const cv::Mat image = TexturedImage(320, 240, 2), other = TexturedImage(400, 200, 3);
  OrbExtractor first(SmallOptions()), second(SmallOptions());
  const FeatureSet expected = first.Extract(image, PlainCamera(image));
  EXPECT_GT(second.Extract(other, PlainCamera(other)).size(), 0u);
  EXPECT_TRUE(AreEqual(second.Extract(image, PlainCamera(image)), expected));
  EXPECT_TRUE(AreEqual(first.Extract(image, PlainCamera(image)), expected));
}

TEST(OrbExtractor, FindsTheSameWithAnyNumberOfThreads) {
  const cv::Mat image = TexturedImage(640, 480, 6);
  OrbOptions options;
  options.threads = 1;
  const FeatureSet expected = OrbExtractor(options).Extract(image, PlainCamera(image));
  for (const int threads : {2, 3, 20}) {
    options.threads = threads;
    OrbExtractor extractor(options);
    for (int i = 0; i < 20; ++i) EXPECT_TRUE(AreEqual(extractor.Extract(image, PlainCamera(image)), expected));
  }
}

TEST(OrbExtractor, LeavesNoPartWithTextureEmpty) {
  cv::Mat image = TexturedImage(640, 480, 4);
  // Three quarters as faint as a wall in shade: corners far below the strength of those in the first quarter.
  for (const cv::Rect& part : {cv::Rect(320, 0, 320, 480), cv::Rect(0, 240, 320, 240)})
    image(part) = image(part) / 8 + 60;
  OrbExtractor extractor((OrbOptions()));
  const FeatureSet features = extractor.Extract(image, PlainCamera(image));
  constexpr int kColumns = 8, kRows = 6;
  std::array<int, kColumns * kRows> counts{};
  for (const Eigen::Vector2f& pixel_px : features.pixels_px) {
    ++counts[static_cast<size_t>(static_cast<int>(pixel_px.y() / 80) * kColumns + static_cast<int>(pixel_px.x() / 80))];
  }
  const double even = static_cast<double>(features.size()) / (kColumns * kRows);
  for (int count : counts) EXPECT_GT(count, even / 4);  // the outermost cells lose a third of their area to the border
  for (int count : counts) EXPECT_LT(count, even * 4);
}

TEST(OrbExtractor, FindsNothingWithoutTexture) {
  const cv::Mat black(480, 640, CV_8UC1, cv::Scalar(0));
  OrbExtractor extractor((OrbOptions()));
  EXPECT_EQ(extractor.Extract(black, PlainCamera(black)).size(), 0u);
  const cv::Mat tiny = TexturedImage(5, 4, 1);
  EXPECT_EQ(extractor.Extract(tiny, PlainCamera(tiny)).size(), 0u);
}

TEST(OrbExtractor, RefusesImagesOfAnotherKindThanTheCameras) {
  OrbExtractor extractor((OrbOptions()));
  const cv::Mat grey = TexturedImage(64, 64, 1);
  CameraModel camera = PlainCamera(grey);
  EXPECT_THROW(extractor.Extract(cv::Mat(64, 64, CV_8UC3), camera), CheckFailure);
  camera.pinhole.width = 65;
  EXPECT_THROW(extractor.Extract(grey, camera), CheckFailure);
}

TEST(OrbExtractor, LocatesOnePlaceAlikeOnEveryLevel) {
  const Eigen::Vector2f centre_px(200.2f, 160.9f);
  cv::Mat image(320, 400, CV_8UC1);
  for (int y = 0; y < image.rows; ++y) {
    for (int x = 0; x < image.cols; ++x) {
      const float squared_distance =
          (Eigen::Vector2f(static_cast<float>(x), static_cast<float>(y)) - centre_px).squaredNorm();
      image.at<uchar>(y, x) =
          cv::saturate_cast<uchar>(60 + 160 * std::exp(-squared_distance / (2 * 4)));  // sigma 2 pixels
    }
  }
  OrbExtractor extractor((OrbOptions()));
  const FeatureSet features = extractor.Extract(image, PlainCamera(image));
  ASSERT_GE(features.size(), 8u);
  for (size_t i = 0; i < features.size(); ++i) {
    if (features.octaves[i] == 0) continue;  // too close to see one corner in it
    // Within a third of a pixel of its level; without the shift by half a pixel between levels, level 7 would be 1.8
    // pixels off.
    const double scale = ScalePyramid().Scale(features.octaves[i]);
    EXPECT_LT((features.pixels_px[i] - centre_px).norm(), 0.33 * scale) << "octave " << int{features.octaves[i]};
  }
  EXPECT_EQ(features.octaves.back(), 7);
}

TEST(OrbExtractor, UndistortsLocationsAndDropsThoseOutside) {
  const cv::Mat image = TexturedImage(640, 480, 5);
  CameraModel camera = PlainCamera(image);
  OrbExtractor extractor(SmallOptions());
  const FeatureSet plain = extractor.Extract(image, camera);
  camera.distortion = Distortion::kRadialTangential;
  camera.coefficients = {-0.2, 0.03, 0.001, -0.001, 0};  // a barrel: corners of the image leave the ideal one
  const FeatureSet ideal = extractor.Extract(image, camera);
  std::vector<cv::Point2f> distorted_px;
  for (const Eigen::Vector2f& pixel_px : plain.pixels_px) distorted_px.emplace_back(pixel_px.x(), pixel_px.y());
  FeatureSet expected;
  const std::vector<cv::Point2f> ideal_px = camera.Undistort(distorted_px);
  for (size_t i = 0; i < plain.size(); ++i) {
    if (!camera.pinhole.Contains({ideal_px[i].x, ideal_px[i].y})) continue;
    expected.pixels_px.emplace_back(ideal_px[i].x, ideal_px[i].y);
    expected.octaves.push_back(plain.octaves[i]);
    expected.angles_rad.push_back(plain.angles_rad[i]);
    expected.descriptors.push_back(plain.descriptors[i]);
  }
  EXPECT_LT(expected.size(), plain.size());
  EXPECT_TRUE(AreEqual(ideal, expected));
}

}  // namespace
}  // namespace portolan
