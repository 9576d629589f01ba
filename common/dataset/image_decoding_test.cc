#include "dataset/image_decoding.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "dataset/media_library.h"

namespace portolan {
namespace {

using testing::HasSubstr;

/// Noise with structure, so that wrong conversions show.
cv::Mat Picture(int type) {
  cv::Mat picture(61, 83, type);
  cv::RNG random(5);
  random.fill(picture, cv::RNG::UNIFORM, 0, CV_MAT_DEPTH(type) == CV_16U ? 65536 : 256);
  return picture;
}

std::vector<uint8_t> Encode(const char* extension, const cv::Mat& picture, const std::vector<int>& parameters = {}) {
  std::vector<uint8_t> bytes;
  EXPECT_TRUE(cv::imencode(extension, picture, bytes, parameters));
  return bytes;
}

struct Kind {
  const char* extension;
  int type;
  std::vector<int> parameters;
};

class DecodeGreyTest : public testing::TestWithParam<Kind> {};

TEST_P(DecodeGreyTest, GivesWhatOpenCvGives) {
  const std::vector<uint8_t> bytes = Encode(GetParam().extension, Picture(GetParam().type), GetParam().parameters);
  const cv::Mat expected = cv::imdecode(bytes, cv::IMREAD_GRAYSCALE);
  const Result<cv::Mat> grey = DecodeGrey(bytes.data(), bytes.size());
  ASSERT_TRUE(grey) << grey.error().message;
  ASSERT_EQ(grey->type(), CV_8UC1);
  ASSERT_EQ(grey->size(), expected.size());
  EXPECT_EQ(cv::norm(*grey, expected, cv::NORM_INF), 0);
}

INSTANTIATE_TEST_SUITE_P(Kinds, DecodeGreyTest,
                         testing::Values(Kind{".jpg", CV_8UC1, {}}, Kind{".jpg", CV_8UC3, {}},
                                         Kind{".jpg", CV_8UC3, {cv::IMWRITE_JPEG_PROGRESSIVE, 1}},
                                         Kind{".png", CV_8UC1, {}}, Kind{".png", CV_8UC3, {}},
                                         Kind{".png", CV_8UC4, {}}, Kind{".png", CV_16UC1, {}},
                                         Kind{".png", CV_16UC3, {}}, Kind{".pgm", CV_8UC1, {}},
                                         Kind{".bmp", CV_8UC3, {}}));

TEST(DecodeGreyTest, AJpegWithAnOrientationIsTurned) {
  std::vector<uint8_t> bytes = Encode(".jpg", Picture(CV_8UC1));
  // APP1 after the start mark: EXIF, big endian, one entry: orientation (0x0112), short, 6 (a quarter turn).
  const std::vector<uint8_t> exif = {0xff, 0xe1, 0,    34,   'E', 'x', 'i', 'f', 0, 0, 'M', 'M', 0, 42, 0, 0, 0, 8,
                                     0,    1,    0x01, 0x12, 0,   3,   0,   0,   0, 1, 0,   6,   0, 0,  0, 0, 0, 0};
  bytes.insert(bytes.begin() + 2, exif.begin(), exif.end());
  const Result<cv::Mat> grey = DecodeGrey(bytes.data(), bytes.size());
  ASSERT_TRUE(grey) << grey.error().message;
  EXPECT_EQ(grey->size(), cv::Size(61, 83));
}

TEST(DecodeGreyTest, SaysWhatIsWrong) {
  const auto problem = [](const std::vector<uint8_t>& bytes) {
    return DecodeGrey(bytes.data(), bytes.size()).error().message;
  };
  EXPECT_EQ(problem({'h', 'e', 'l', 'l', 'o'}), "is not an image that can be decoded");
  EXPECT_THAT(problem({0xff, 0xd8, 0xff, 'x', 'y', 'z'}), HasSubstr("can't be decoded"));
  std::vector<uint8_t> png = Encode(".png", Picture(CV_8UC1));
  png.resize(png.size() / 2);
  EXPECT_EQ(problem(png), "can't be decoded: the data ends early");
  png = Encode(".png", Picture(CV_8UC1));
  png[20] = 0xff;  // of the width
  EXPECT_THAT(problem(png), HasSubstr("can't be decoded"));
}

/// Whatever bytes come: an image or an error.
/// A header may claim any size, whatever follows it (found by test/reliability/fuzz.sh).
TEST(DecodeGreyTest, RefusesWhatIsLargerThanAnyCamerasByItsHeader) {
  const auto message = [](const std::vector<uint8_t>& bytes) {
    const Result<cv::Mat> grey = DecodeGrey(bytes.data(), bytes.size());
    return grey.ok() ? "" : grey.error().message;
  };
  EXPECT_THAT(message(Encode(".png", cv::Mat(1, 16385, CV_8UC1, cv::Scalar(0)))), HasSubstr("is 16385 x 1 pixels"));
  EXPECT_EQ(message(Encode(".png", cv::Mat(1, 16384, CV_8UC1, cv::Scalar(0)))), "");
  std::vector<uint8_t> jpeg = Encode(".jpg", Picture(CV_8UC1));
  const std::vector<uint8_t> start_of_frame = {0xff, 0xc0};
  const auto frame = std::search(jpeg.begin(), jpeg.end(), start_of_frame.begin(), start_of_frame.end());
  ASSERT_LT(frame, jpeg.end() - 9);
  for (int i = 0; i < 2; ++i) {  // after mark, length and precision: height and width
    frame[5 + 2 * i] = 8000 >> 8;
    frame[6 + 2 * i] = 8000 & 0xff;
  }
  EXPECT_THAT(message(jpeg), HasSubstr("is 8000 x 8000 pixels, expected sides of at most 16384 and 33554432 pixels"));
}

TEST(DecodeGreyTest, SurvivesDamage) {
  cv::RNG random(7);
  for (const char* extension : {".jpg", ".png"}) {
    const std::vector<uint8_t> whole = Encode(extension, Picture(CV_8UC3));
    for (int run = 0; run < 300; ++run) {
      std::vector<uint8_t> bytes = whole;
      for (int k = random.uniform(1, 20); k > 0; --k) {
        bytes[static_cast<size_t>(random.uniform(8, static_cast<int>(bytes.size())))] =
            static_cast<uint8_t>(random.uniform(0, 256));
      }
      bytes.resize(static_cast<size_t>(random.uniform(9, static_cast<int>(bytes.size()) + 1)));
      const Result<cv::Mat> grey = DecodeGrey(bytes.data(), bytes.size());
      EXPECT_TRUE(!grey || !grey->empty());
    }
  }
}

TEST(MediaLibraryTest, SaysWhatItTried) {
  testing::GTEST_FLAG(death_test_style) = "threadsafe";  // a process of its own: here the library may be loaded already
  EXPECT_EXIT(
      {
        setenv("PORTOLAN_MEDIA", "/no/such.so", 1);
        const auto module = LoadMediaModule();
        std::fprintf(stderr, "%s", module ? "loaded" : module.error().message.c_str());
        std::exit(module ? 1 : 0);
      },
      testing::ExitedWithCode(0), "codecs of OpenCV: /no/such.so");
}

}  // namespace
}  // namespace portolan
