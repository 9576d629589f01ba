#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>
#include <string>
#include <vector>

#include "dataset/image_source.h"
#include "dataset/temp_folder.h"

namespace portolan {
namespace {

using testing::HasSubstr;

constexpr int kFrames = 20;
constexpr double kFps = 20;

class VideoSourceTest : public testing::Test {
 protected:
  /// Motion JPEG of colour frames whose grey value is 10 times their number.
  VideoSourceTest() {
    folder_.Write("camera.yaml", "model: pinhole\nwidth: 64\nheight: 48\nfx: 60\nfy: 60\ncx: 32\ncy: 24\n");
    cv::VideoWriter writer(folder_.Path("v.avi"), cv::CAP_FFMPEG, cv::VideoWriter::fourcc('M', 'J', 'P', 'G'), kFps,
                           cv::Size(64, 48));
    can_write_ = writer.isOpened();
    for (int i = 0; i < kFrames && can_write_; ++i) writer.write(cv::Mat(48, 64, CV_8UC3, cv::Scalar::all(10 * i)));
  }
  void SetUp() override {
    if (!can_write_) GTEST_SKIP() << "this OpenCV can't write Motion JPEG";
  }
  Result<std::unique_ptr<ImageSource>> Open(SourceOptions options = {}) {
    options.data = folder_.Path("v.avi");
    return OpenImageSource(options);
  }
  const TempFolder folder_;
  bool can_write_ = false;
};

TEST_F(VideoSourceTest, DeliversEveryFrameAtItsTime) {
  EXPECT_EQ(*DetectLayout(folder_.Path("v.avi")), DatasetLayout::kVideo);
  const auto source = Open();
  ASSERT_TRUE(source) << source.error().message;
  EXPECT_EQ((*source)->NumFrames(), uint64_t{kFrames});
  for (int i = 0; i < kFrames; ++i) {
    const auto image = (*source)->Next();
    ASSERT_TRUE(image) << image.error().message;
    ASSERT_TRUE(*image) << i;
    EXPECT_EQ((*image)->frame, static_cast<uint64_t>(i));
    EXPECT_NEAR((*image)->stamp.Seconds(), i / kFps, 1e-3);
    EXPECT_EQ((*image)->grey.type(), CV_8UC1);
    EXPECT_NEAR((*image)->grey.at<uchar>(20, 20), 10 * i, 3);
  }
  const auto end = (*source)->Next();
  ASSERT_TRUE(end) << end.error().message;
  EXPECT_FALSE(*end);
}

TEST_F(VideoSourceTest, ShowsASpan) {
  SourceOptions options;
  options.first_frame = 5;
  options.max_frames = 3;
  const auto source = Open(options);
  ASSERT_TRUE(source) << source.error().message;
  EXPECT_EQ((*source)->NumFrames(), 3u);
  (*source)->Skip();
  std::vector<uint64_t> frames;
  while (true) {
    const auto image = (*source)->Next();
    ASSERT_TRUE(image);
    if (!*image) break;
    frames.push_back((*image)->frame);
    EXPECT_NEAR((*image)->stamp.Seconds(), static_cast<double>((*image)->frame) / kFps, 1e-3);
  }
  EXPECT_THAT(frames, testing::ElementsAre(6, 7));
  options.first_frame = 100;
  EXPECT_THAT(Open(options).error().message, HasSubstr("first frame 100 asked for, but there are 20"));
}

TEST_F(VideoSourceTest, RefusesWhatIsNoVideoOrHasAnotherSize) {
  SourceOptions options;
  options.data = folder_.Write("text.avi", "not a video");
  EXPECT_EQ(OpenImageSource(options).error().message, options.data + ": is not a video that FFmpeg can read");
  folder_.Write("camera.yaml", kSmallCamera);
  EXPECT_THAT(Open().error().message,
              HasSubstr("v.avi: is 64 x 48 pixels, but the camera's calibration is for 32 x 24"));
  std::filesystem::remove(folder_.Path("camera.yaml"));
  EXPECT_THAT(Open().error().message, HasSubstr("no calibration"));
}

TEST_F(VideoSourceTest, AVideoCutShortEndsWithAnErrorOnce) {
  folder_.CutShort("v.avi", 0.5);
  const auto source = Open();
  if (!source) {
    EXPECT_THAT(source.error().message, HasSubstr("is not a video that FFmpeg can read"));
    return;
  }
  int images = 0;
  std::vector<std::string> failures;
  while (true) {
    const auto image = (*source)->Next();
    if (!image) {
      failures.push_back(image.error().message);
    } else if (*image) {
      ++images;
    } else {
      break;
    }
  }
  EXPECT_LT(images, kFrames);
  EXPECT_FALSE(failures.empty());
  EXPECT_THAT(failures.back(), HasSubstr("cut short or damaged"));
}

}  // namespace
}  // namespace portolan
