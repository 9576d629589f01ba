#include "dataset/image_source.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "dataset/temp_folder.h"

namespace portolan {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

constexpr char kKittiCalibration[] = "P0: 30 0 16 0 0 30 12 0 0 0 1 0\n";
constexpr char kEurocCalibration[] =
    "camera_model: pinhole\nresolution: [32, 24]\nintrinsics: [30, 30, 16, 12]\ndistortion_model: radial-tangential\n"
    "distortion_coefficients: [0, 0, 0, 0]\nrate_hz: 20\n";

class ImageSourceTest : public testing::Test {
 protected:
  Result<std::unique_ptr<ImageSource>> Open(SourceOptions options = {}) {
    options.data = folder_.path();
    return OpenImageSource(options);
  }
  std::string FailureOf(SourceOptions options = {}) {
    const auto source = Open(std::move(options));
    return source ? "no failure" : source.error().message;
  }
  /// Grey values of 10, 20, 30 ... in order.
  void WriteTum(int num_images) {
    std::string list = "# timestamp filename\n";
    for (int i = 0; i < num_images; ++i) {
      const std::string name = "rgb/" + std::to_string(i) + ".png";
      list += std::to_string(100 + i) + ".5 " + name + "\n";
      folder_.WriteImage(name, 10 * (i + 1));
    }
    folder_.Write("rgb.txt", list);
    folder_.Write("camera.yaml", kSmallCamera);
  }
  const TempFolder folder_;
};

/// What a source delivered: grey values, stamps, frame numbers and the messages of failures.
struct Delivered {
  std::vector<int> greys;
  std::vector<double> seconds;
  std::vector<uint64_t> frames;
  std::vector<std::string> failures;
};

Delivered ReadToEnd(ImageSource* source) {
  Delivered delivered;
  while (true) {
    Result<std::optional<Image>> image = source->Next();
    if (!image) {
      delivered.failures.push_back(image.error().message);
      continue;
    }
    if (!*image) return delivered;
    EXPECT_EQ((*image)->grey.type(), CV_8UC1);
    delivered.greys.push_back((*image)->grey.at<uchar>(5, 5));
    delivered.seconds.push_back((*image)->stamp.Seconds());
    delivered.frames.push_back((*image)->frame);
  }
}

TEST_F(ImageSourceTest, ReadsTum) {
  WriteTum(3);
  EXPECT_EQ(*DetectLayout(folder_.path()), DatasetLayout::kTum);
  const auto source = Open();
  ASSERT_TRUE(source) << source.error().message;
  EXPECT_EQ((*source)->NumFrames(), 3u);
  EXPECT_FALSE((*source)->IsLive());
  EXPECT_EQ((*source)->camera().pinhole.fx, 30);
  EXPECT_EQ((*source)->PeekStamp()->ns, 100500000000);
  const Delivered delivered = ReadToEnd(source->get());
  EXPECT_THAT(delivered.greys, ElementsAre(10, 20, 30));
  EXPECT_THAT(delivered.seconds, ElementsAre(100.5, 101.5, 102.5));
  EXPECT_THAT(delivered.frames, ElementsAre(0, 1, 2));
  EXPECT_TRUE(delivered.failures.empty());
  EXPECT_EQ((*source)->PeekStamp(), std::nullopt);
}

TEST_F(ImageSourceTest, ReadsKittiAndTakesTheSizeFromTheFirstImage) {
  folder_.WriteImage("image_0/000000.png", 1);
  folder_.WriteImage("image_0/000001.png", 2);
  folder_.Write("times.txt", "0.000000e+00\n1.037359e-01\n");
  folder_.Write("calib.txt", kKittiCalibration);
  EXPECT_EQ(*DetectLayout(folder_.path()), DatasetLayout::kKitti);
  const auto source = Open();
  ASSERT_TRUE(source) << source.error().message;
  EXPECT_EQ((*source)->camera().pinhole.width, 32);
  EXPECT_EQ((*source)->camera().pinhole.height, 24);
  const Delivered delivered = ReadToEnd(source->get());
  EXPECT_THAT(delivered.greys, ElementsAre(1, 2));
  EXPECT_THAT(delivered.seconds, ElementsAre(0, 0.1037359));
}

TEST_F(ImageSourceTest, ReadsTheFirstOfKittisCamerasThatIsThere) {
  std::string calibration;
  for (int camera = 0; camera < 4; ++camera) {
    calibration += "P" + std::to_string(camera) + ": " + std::to_string(30 + camera) + " 0 16 " +
                   std::to_string(5 * camera) + " 0 30 12 0 0 0 1 0\n";
    folder_.WriteImage("image_" + std::to_string(camera) + "/000000.png", 10 * (camera + 1));
  }
  folder_.Write("calib.txt", calibration);
  folder_.Write("times.txt", "0\n");
  for (int camera = 0; camera < 4; ++camera) {
    EXPECT_EQ(*DetectLayout(folder_.path()), DatasetLayout::kKitti);
    const auto source = Open();
    ASSERT_TRUE(source) << source.error().message;
    EXPECT_EQ((*source)->camera().pinhole.fx, 30 + camera) << "of row P" << camera;
    EXPECT_THAT(ReadToEnd(source->get()).greys, ElementsAre(10 * (camera + 1)));
    std::filesystem::remove_all(folder_.Path("image_" + std::to_string(camera)));
  }
  folder_.WriteImage("image_2/000000.png", 1);
  folder_.Write("calib.txt", kKittiCalibration);
  EXPECT_EQ(FailureOf(), folder_.Path("calib.txt") + ": row 'P2:' is missing");
}

TEST_F(ImageSourceTest, ReadsEurocFromItsTopOrItsCameraFolder) {
  folder_.WriteImage("mav0/cam0/data/1403636579763555584.png", 50);
  folder_.WriteImage("mav0/cam0/data/1403636579813555456.png", 60);
  folder_.Write("mav0/cam0/data.csv",
                "#timestamp "
                "[ns],filename\r\n1403636579763555584,1403636579763555584.png\r\n1403636579813555456,"
                "1403636579813555456.png\r\n");
  folder_.Write("mav0/cam0/sensor.yaml", kEurocCalibration);
  for (const char* below : {"", "/mav0", "/mav0/cam0"}) {
    SourceOptions options;
    options.data = folder_.path() + below;
    EXPECT_EQ(*DetectLayout(options.data), DatasetLayout::kEuroc);
    const auto source = OpenImageSource(options);
    ASSERT_TRUE(source) << source.error().message;
    EXPECT_EQ((*source)->PeekStamp()->ns, 1403636579763555584) << "exact to the nanosecond";
    EXPECT_THAT(ReadToEnd(source->get()).greys, ElementsAre(50, 60));
  }
}

TEST_F(ImageSourceTest, ReadsAPlainFolderInEveryFormOfTimes) {
  folder_.Write("camera.yaml", kSmallCamera);
  folder_.WriteImage("img10.png", 100);
  folder_.WriteImage("img9.png", 90);
  const auto greys_and_times = [&] {
    const auto source = Open();
    EXPECT_TRUE(source) << (source ? "" : source.error().message);
    const Delivered delivered = ReadToEnd(source->get());
    EXPECT_THAT(delivered.greys, ElementsAre(90, 100));
    return delivered.seconds;
  };
  EXPECT_EQ(*DetectLayout(folder_.path()), DatasetLayout::kPlain);
  EXPECT_THAT(greys_and_times(), ElementsAre(0, 0.1)) << "without times: by name at the camera's rate";
  folder_.Write("times.txt", "5\n6.5\n");
  EXPECT_THAT(greys_and_times(), ElementsAre(5, 6.5));
  folder_.Write("times.txt", "img9.png 2\nimg10.png 3\n");
  EXPECT_THAT(greys_and_times(), ElementsAre(2, 3));
  folder_.Write("times.txt", "1 img9.png\n4 img10.png\n");
  EXPECT_THAT(greys_and_times(), ElementsAre(1, 4));
}

TEST_F(ImageSourceTest, ShowsASpanAndKeepsTheNumbersOfItsFrames) {
  WriteTum(5);
  SourceOptions options;
  options.first_frame = 1;
  options.max_frames = 3;
  const auto source = Open(options);
  ASSERT_TRUE(source);
  EXPECT_EQ((*source)->NumFrames(), 3u);
  (*source)->Skip();
  const Delivered delivered = ReadToEnd(source->get());
  EXPECT_THAT(delivered.frames, ElementsAre(2, 3));
  EXPECT_THAT(delivered.greys, ElementsAre(30, 40));
  (*source)->Skip();  // at the end: nothing happens
  EXPECT_FALSE(*(*source)->Next());
  options.first_frame = 5;
  EXPECT_THAT(FailureOf(options), HasSubstr("first frame 5 asked for, but there are 5 frames"));
}

TEST_F(ImageSourceTest, AFrameThatCannotBeReadIsAnErrorAndTheNextOneComes) {
  WriteTum(6);
  std::filesystem::remove(folder_.Path("rgb/1.png"));
  folder_.CutShort("rgb/2.png", 0.7);
  folder_.WriteImage("rgb/3.png", 40, {16, 12});
  folder_.Write("rgb/4.png", "not an image");
  const auto source = Open();
  ASSERT_TRUE(source) << source.error().message;
  const Delivered delivered = ReadToEnd(source->get());
  EXPECT_THAT(delivered.frames, ElementsAre(0, 5));
  EXPECT_THAT(delivered.failures,
              ElementsAre(HasSubstr("rgb/1.png: can't be opened"), HasSubstr("rgb/2.png: the image file is cut short"),
                          HasSubstr("rgb/3.png: is 16 x 12 pixels, but the camera's calibration is for 32 x 24"),
                          HasSubstr("rgb/4.png: is not an image")));
}

TEST_F(ImageSourceTest, AnUnreadableFirstImageIsALostFrameToo) {
  WriteTum(2);
  folder_.CutShort("rgb/0.png", 0.7);
  const auto source = Open();
  ASSERT_TRUE(source) << source.error().message;
  const Delivered delivered = ReadToEnd(source->get());
  EXPECT_THAT(delivered.frames, ElementsAre(1));
  EXPECT_EQ(delivered.failures.size(), 1u);
}

TEST_F(ImageSourceTest, RefusesAListWhoseImagesAreAllMissingOrUnreadable) {
  WriteTum(2);
  folder_.Write("rgb/0.png", "x");
  folder_.Write("rgb/1.png", "x");
  EXPECT_THAT(FailureOf(), HasSubstr("none of 2 images can be read; the first: " + folder_.Path("rgb/0.png")));
  std::filesystem::remove_all(folder_.Path("rgb"));
  EXPECT_THAT(FailureOf(), HasSubstr("none of the 2 listed images exists; the first is " + folder_.Path("rgb/0.png")));
  folder_.Write("rgb.txt", "# nothing\n");
  EXPECT_THAT(FailureOf(), HasSubstr("lists no image"));
}

TEST_F(ImageSourceTest, TumTimesMustRise) {
  WriteTum(3);
  folder_.Write("rgb.txt", "# list\n1.0 rgb/0.png\n3.0 rgb/1.png\n2.0 rgb/2.png\n");
  EXPECT_EQ(FailureOf(), folder_.Path("rgb.txt") + ":4: times must rise, but 2.000000000 s follows 3.000000000 s");
  folder_.Write("rgb.txt", "1.0 rgb/0.png\n1.0 rgb/1.png\n");
  EXPECT_THAT(FailureOf(), HasSubstr("rgb.txt:2: times must rise"));
}

TEST_F(ImageSourceTest, KittiTimesMustRise) {
  for (const char* name : {"image_0/000000.png", "image_0/000001.png", "image_0/000002.png"})
    folder_.WriteImage(name, 1);
  folder_.Write("calib.txt", kKittiCalibration);
  folder_.Write("times.txt", "0\n1.037359e-01\n1.0e-01\n");
  EXPECT_EQ(FailureOf(), folder_.Path("times.txt") + ":3: times must rise, but 0.100000000 s follows 0.103735900 s");
  folder_.Write("times.txt", "0\n0\n1\n");
  EXPECT_THAT(FailureOf(), HasSubstr("times.txt:2: times must rise"));
}

TEST_F(ImageSourceTest, EurocTimesMustRise) {
  folder_.WriteImage("mav0/cam0/data/a.png", 1);
  folder_.Write("mav0/cam0/sensor.yaml", kEurocCalibration);
  const std::string list = folder_.Write("mav0/cam0/data.csv",
                                         "#timestamp [ns],filename\n1403636579763555584,a.png\n"
                                         "1403636579763555583,a.png\n");
  EXPECT_EQ(FailureOf(), list + ":3: times must rise, but 1403636579.763555583 s follows 1403636579.763555584 s");
  folder_.Write("mav0/cam0/data.csv", "5,a.png\n5,a.png\n");
  EXPECT_THAT(FailureOf(), HasSubstr("data.csv:2: times must rise"));
}

TEST_F(ImageSourceTest, PlainTimesMustRiseInEveryForm) {
  folder_.Write("camera.yaml", kSmallCamera);
  for (const char* name : {"a.png", "b.png"}) folder_.WriteImage(name, 1);
  for (const char* times : {"2\n1\n", "a.png 2\nb.png 1\n", "2 a.png\n1 b.png\n"}) {
    folder_.Write("times.txt", times);
    EXPECT_EQ(FailureOf(), folder_.Path("times.txt") + ":2: times must rise, but 1.000000000 s follows 2.000000000 s");
  }
}

TEST_F(ImageSourceTest, NamesTheLineThatDoesNotParse) {
  WriteTum(2);
  folder_.Write("rgb.txt", "1.0 rgb/0.png\nx rgb/1.png\n");
  EXPECT_EQ(FailureOf(), folder_.Path("rgb.txt") + ":2: expected 'seconds file', found 'x rgb/1.png'");
  folder_.Write("rgb.txt", "1.0\n");
  EXPECT_THAT(FailureOf(), HasSubstr("rgb.txt:1: expected 'seconds file', found '1.0'"));
  folder_.Write("rgb.txt", "nan rgb/0.png\n");
  EXPECT_THAT(FailureOf(), HasSubstr("rgb.txt:1: expected"));
}

TEST_F(ImageSourceTest, KittiNeedsATimeForEveryImage) {
  folder_.WriteImage("image_0/000000.png", 1);
  folder_.WriteImage("image_0/000001.png", 2);
  folder_.Write("calib.txt", kKittiCalibration);
  folder_.Write("times.txt", "0\n");
  EXPECT_THAT(FailureOf(), HasSubstr("times.txt: has 1 times for 2 images in "));
  folder_.Write("times.txt", "0\n1 2\n");
  EXPECT_THAT(FailureOf(), HasSubstr("times.txt:2: expected one time in seconds, found '1 2'"));
}

TEST_F(ImageSourceTest, PlainTimesMustFitTheImages) {
  folder_.Write("camera.yaml", kSmallCamera);
  folder_.WriteImage("a.png", 1);
  folder_.Write("times.txt", "1\n2\n");
  EXPECT_THAT(FailureOf(), HasSubstr("times.txt: has 2 times for 1 images"));
  folder_.Write("times.txt", "a.png 1\n2\n");
  EXPECT_THAT(FailureOf(), HasSubstr("times.txt:2: expected"));
  folder_.Write("times.txt", "1 2\n");
  EXPECT_THAT(FailureOf(), HasSubstr("times.txt:1: expected"));
}

TEST_F(ImageSourceTest, TheCameraMustBeFoundAndFit) {
  WriteTum(1);
  std::filesystem::remove(folder_.Path("camera.yaml"));
  EXPECT_THAT(FailureOf(), HasSubstr("no calibration: looked for camera.yaml, sensor.yaml and calib.txt"));
  folder_.Write("camera.yaml", "model: pinhole\nwidth: 64\nheight: 48\nfx: 30\nfy: 30\ncx: 16\ncy: 12\n");
  EXPECT_THAT(FailureOf(), HasSubstr("rgb/0.png: is 32 x 24 pixels, but the camera's calibration is for 64 x 48"));
  folder_.Write("camera.yaml", "model: pinhole\nwidth: 32\nheight: 24\nfx: -30\nfy: 30\ncx: 16\ncy: 12\n");
  EXPECT_THAT(FailureOf(), HasSubstr("camera.yaml:4: fx: expected a finite number above 0, found '-30'"));
  SourceOptions options;
  options.camera_file = folder_.Write("elsewhere/good.yaml", kSmallCamera);
  EXPECT_EQ(FailureOf(options), "no failure");
  options.camera_file = folder_.Path("none.yaml");
  EXPECT_THAT(FailureOf(options), HasSubstr("none.yaml: can't be opened"));
}

TEST_F(ImageSourceTest, WhatIsNoDataSetSaysWhatWasLookedFor) {
  EXPECT_THAT(DetectLayout(folder_.path()).error().message,
              HasSubstr("looked for image_0/ to image_3/ with times.txt (KITTI), rgb.txt (TUM)"));
  EXPECT_EQ(DetectLayout("/nowhere").error().message, "/nowhere: no such folder or file");
  EXPECT_EQ(*DetectLayout("/dev/video7"), DatasetLayout::kDevice);
  SourceOptions options;
  options.data = "/dev/video7";
  EXPECT_EQ(OpenImageSource(options).error().message, "/dev/video7: a camera needs a calibration file (--camera)");
}

struct SharedSequence {
  std::string name;
  DatasetLayout layout;
  uint64_t frames;
  int width;
};

TEST_F(ImageSourceTest, OpensTheSharedSequences) {
  const std::string data = SharedDataFolder();
  if (data.empty()) GTEST_SKIP() << "no shared/data beside the repository and PORTOLAN_DATA is not set";
  for (const SharedSequence& sequence : {SharedSequence{"kitti_00", DatasetLayout::kKitti, 300, 1241},
                                         {"kitchen", DatasetLayout::kTum, 1000, 640},
                                         {"office_walk", DatasetLayout::kTum, 373, 540},
                                         {"town_lap", DatasetLayout::kKitti, 1138, 620},
                                         {"blackout", DatasetLayout::kTum, 761, 640},
                                         {"halls", DatasetLayout::kTum, 1070, 640}}) {
    SourceOptions options;
    options.data = data + "/" + sequence.name;
    EXPECT_EQ(*DetectLayout(options.data), sequence.layout) << sequence.name;
    const auto source = OpenImageSource(options);
    ASSERT_TRUE(source) << source.error().message;
    EXPECT_EQ((*source)->NumFrames(), sequence.frames) << sequence.name;
    EXPECT_EQ((*source)->camera().pinhole.width, sequence.width) << sequence.name;
    const auto first = (*source)->Next();
    ASSERT_TRUE(first && *first) << sequence.name;
    EXPECT_EQ((*first)->grey.cols, sequence.width);
  }
}

}  // namespace
}  // namespace portolan
