#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>
#include <opencv2/videoio.hpp>
#include <string>
#include <vector>

#include "dataset/sources.h"
#include "dataset/temp_folder.h"

namespace portolan {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::Ge;
using testing::Lt;

constexpr char kDevice[] = "/dev/video9";

/// What a camera has when it is asked for a frame.
struct Shot {
  double driver_ms = 0;  ///< capture time; 0 of a driver that gives none
  cv::Mat picture;
  bool can_be_grabbed = true;
  bool can_be_retrieved = true;
};

/// A camera's script, and what it was asked for.
struct FakeCamera {
  bool opens = true;
  bool obeys = true;  ///< takes the size and rate that it is asked for
  std::vector<Shot> shots;
  std::map<int, double> properties{{cv::CAP_PROP_FRAME_WIDTH, 64}, {cv::CAP_PROP_FRAME_HEIGHT, 48}};
  std::map<int, double> asked_for{};
};

class FakeStream : public VideoStream {
 public:
  explicit FakeStream(FakeCamera* camera) : camera_(*camera) {}
  bool IsOpened() const override { return camera_.opens; }
  bool Grab() override {
    if (next_ == camera_.shots.size()) return false;
    return camera_.shots[next_++].can_be_grabbed;
  }
  bool Retrieve(cv::Mat* picture) override {
    const Shot& shot = camera_.shots.at(next_ - 1);
    *picture = shot.picture;
    return shot.can_be_retrieved;
  }
  double Get(int property) const override {
    return property == cv::CAP_PROP_POS_MSEC ? camera_.shots.at(next_ - 1).driver_ms : camera_.properties.at(property);
  }
  void Set(int property, double value) override {
    camera_.asked_for[property] = value;
    if (camera_.obeys) camera_.properties[property] = value;
  }

 private:
  FakeCamera& camera_;
  size_t next_ = 0;
};

cv::Mat Picture(int grey) {
  return cv::Mat(24, 32, CV_8UC1, cv::Scalar(grey));
}

CameraModel Calibration() {
  CameraModel camera;
  camera.pinhole = {30, 30, 16, 12, 32, 24};
  camera.fps = 25;
  return camera;
}

Result<std::unique_ptr<ImageSource>> Open(FakeCamera* fake, const CameraModel& calibration = Calibration(),
                                          SourceOptions options = {}) {
  options.data = kDevice;
  return OpenCameraSource(options, calibration, std::make_unique<FakeStream>(fake));
}

/// What a source delivered to its end: a frame as "number: grey value", a failure as its message.
std::vector<std::string> ReadToEnd(ImageSource* source) {
  std::vector<std::string> told;
  while (true) {
    const Result<std::optional<Image>> image = source->Next();
    if (image && !*image) return told;
    told.push_back(image ? std::to_string((*image)->frame) + ": " + std::to_string((*image)->grey.at<uchar>(5, 5))
                         : image.error().message);
  }
}

TEST(CameraSourceTest, NamesACameraThatCannotBeOpened) {
  FakeCamera fake;
  fake.opens = false;
  EXPECT_EQ(Open(&fake).error().message, "/dev/video9: no camera that V4L2 can open");
  const TempFolder folder;
  SourceOptions options;
  options.data = "/dev/video_that_is_not_there";
  options.camera_file = folder.Write("camera.yaml", kSmallCamera);
  EXPECT_EQ(OpenImageSource(options).error().message, options.data + ": no camera that V4L2 can open")
      << "through OpenCV";
}

TEST(CameraSourceTest, AsksForTheCalibrationsSizeAndRate) {
  FakeCamera fake;
  const auto source = Open(&fake);
  ASSERT_TRUE(source) << source.error().message;
  EXPECT_EQ(
      fake.asked_for,
      (std::map<int, double>{{cv::CAP_PROP_FRAME_WIDTH, 32}, {cv::CAP_PROP_FRAME_HEIGHT, 24}, {cv::CAP_PROP_FPS, 25}}));
  EXPECT_EQ((*source)->camera().pinhole, Calibration().pinhole);
  EXPECT_TRUE((*source)->IsLive());
  EXPECT_EQ((*source)->NumFrames(), std::nullopt);
  EXPECT_EQ((*source)->PeekStamp(), std::nullopt);
}

TEST(CameraSourceTest, ACalibrationWithoutSizeAndRateTakesTheCamerasAndTheOptions) {
  FakeCamera fake;
  CameraModel calibration = Calibration();
  calibration.pinhole.width = calibration.pinhole.height = 0;
  calibration.fps = 0;
  SourceOptions options;
  options.camera_fps = 15;
  const auto source = Open(&fake, calibration, options);
  ASSERT_TRUE(source) << source.error().message;
  EXPECT_EQ(fake.asked_for, (std::map<int, double>{{cv::CAP_PROP_FPS, 15}}));
  EXPECT_EQ((*source)->camera().pinhole.width, 64);
  EXPECT_EQ((*source)->camera().pinhole.height, 48);
}

TEST(CameraSourceTest, RefusesACameraWithoutTheCalibrationsSize) {
  FakeCamera fake;
  fake.obeys = false;
  EXPECT_EQ(Open(&fake).error().message, "/dev/video9: is 64 x 48 pixels, but the camera's calibration is for 32 x 24");
}

TEST(CameraSourceTest, DeliversFramesInGreyAtTheDriversTimes) {
  FakeCamera fake;
  const cv::Mat red(24, 32, CV_8UC3, cv::Scalar(0, 0, 255));
  fake.shots = {{40, Picture(10)}, {80.000001, red}};
  const auto source = Open(&fake);
  ASSERT_TRUE(source) << source.error().message;
  const auto first = (*source)->Next();
  ASSERT_TRUE(first && *first);
  EXPECT_EQ((*first)->frame, 0u);
  EXPECT_EQ((*first)->stamp.ns, 40000000);
  EXPECT_EQ((*first)->grey.type(), CV_8UC1);
  EXPECT_EQ((*first)->grey.at<uchar>(5, 5), 10);
  const auto second = (*source)->Next();
  ASSERT_TRUE(second && *second);
  EXPECT_EQ((*second)->frame, 1u);
  EXPECT_EQ((*second)->stamp.ns, 80000001);
  EXPECT_EQ((*second)->grey.type(), CV_8UC1);
  EXPECT_NEAR((*second)->grey.at<uchar>(5, 5), 76, 1) << "0.299 of 255: red's share of the luminance";
}

TEST(CameraSourceTest, SkipsAFrameAndEndsAfterTheNumberAskedFor) {
  FakeCamera fake;
  for (int i = 1; i <= 5; ++i) fake.shots.push_back({40.0 * i, Picture(10 * i)});
  SourceOptions options;
  options.max_frames = 3;
  const auto source = Open(&fake, Calibration(), options);
  ASSERT_TRUE(source) << source.error().message;
  (*source)->Skip();
  EXPECT_THAT(ReadToEnd(source->get()), ElementsAre("1: 20", "2: 30"));
}

TEST(CameraSourceTest, WithoutRisingTimesOfTheDriverTheSystemsClockCounts) {
  const Timestamp before = Timestamp::Now();
  const auto stamps_ns = [](const std::vector<double>& driver_ms) {
    FakeCamera fake;
    for (const double ms : driver_ms) fake.shots.push_back({ms, Picture(1)});
    const auto source = Open(&fake);
    std::vector<int64_t> stamps;
    for (size_t i = 0; i < driver_ms.size(); ++i) stamps.push_back((*(*source)->Next())->stamp.ns);
    return stamps;
  };
  constexpr int64_t kYear2096 = 4000000000000000000;
  const auto by_system = AllOf(Ge(before.ns), Lt(kYear2096));
  EXPECT_THAT(stamps_ns({0, 0}), ElementsAre(by_system, by_system)) << "a driver that gives none";
  EXPECT_THAT(stamps_ns({40, 40, 80}), ElementsAre(40000000, by_system, by_system)) << "one that stands still once";
  EXPECT_THAT(stamps_ns({40, 30, 80}), ElementsAre(40000000, by_system, by_system)) << "one that goes back";
  EXPECT_THAT(stamps_ns({40, 40, kYear2096 / 1e6}), ElementsAre(40000000, by_system, by_system)) << "for good";
}

TEST(CameraSourceTest, ThreeFailuresInARowAreTheEnd) {
  const Shot not_grabbed{0, Picture(1), false, true};
  const Shot not_retrieved{0, Picture(2), true, false};
  const Shot empty{0, {}, true, true};
  FakeCamera fake;
  fake.shots = {not_grabbed, not_retrieved, {40, Picture(10)}, not_grabbed, empty, not_retrieved, {80, Picture(20)}};
  const auto source = Open(&fake);
  ASSERT_TRUE(source) << source.error().message;
  const std::string lost_first = "/dev/video9: frame 0: the camera delivers no image";
  const std::string lost_next = "/dev/video9: frame 1: the camera delivers no image";
  EXPECT_THAT(ReadToEnd(source->get()), ElementsAre(lost_first, lost_first, "0: 10", lost_next, lost_next, lost_next));
  const auto after = (*source)->Next();
  ASSERT_TRUE(after) << after.error().message;
  EXPECT_FALSE(*after) << "and stays the end, though the camera would have another";
}

TEST(CameraSourceTest, FramesOfAnotherSizeAreLostAndNotTheEnd) {
  FakeCamera fake;
  for (int i = 1; i <= 4; ++i) fake.shots.push_back({40.0 * i, cv::Mat(12, 16, CV_8UC1, cv::Scalar(0))});
  fake.shots.push_back({200, Picture(50)});
  const auto source = Open(&fake);
  ASSERT_TRUE(source) << source.error().message;
  std::vector<std::string> told = ReadToEnd(source->get());
  const std::string other_size = "/dev/video9: is 16 x 12 pixels, but the camera's calibration is for 32 x 24";
  ASSERT_GE(told.size(), 5u);
  told.resize(5);  // after these the script has nothing more
  EXPECT_THAT(told, ElementsAre(other_size, other_size, other_size, other_size, "4: 50"));
}

}  // namespace
}  // namespace portolan
