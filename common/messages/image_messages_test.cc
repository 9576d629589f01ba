#include "messages/image_messages.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "messages/malformed_messages.h"
#include "messages/random_messages.h"

namespace portolan {
namespace {

using testing::HasSubstr;
using WireImage = sensor_msgs::msg::dds_::Image_;
using WireCompressed = sensor_msgs::msg::dds_::CompressedImage_;

bool SamePixels(const cv::Mat& a, const cv::Mat& b) {
  return a.size() == b.size() && a.type() == b.type() && cv::norm(a, b, cv::NORM_INF) == 0;
}

TEST(ImageMessagesTest, GreyImagesComeBack) {
  Random random(1);
  Image sent = RandomImage(33, 17, &random);
  for (const int64_t stamp_ns : {int64_t{0}, int64_t{1}, int64_t{1700000000123456789}, int64_t{-1}}) {
    sent.stamp.ns = stamp_ns;
    const Result<Image> received = FromWire(ToWire(sent));
    ASSERT_TRUE(received.ok()) << received.error().message;
    EXPECT_EQ(received->stamp, sent.stamp);
    EXPECT_TRUE(SamePixels(received->grey, sent.grey));
  }
}

TEST(ImageMessagesTest, AViewIntoALargerImageComesBack) {
  Random random(2);
  Image sent = RandomImage(64, 48, &random);
  sent.grey = sent.grey(cv::Rect(8, 4, 20, 10));
  const Result<Image> received = FromWire(ToWire(sent));
  ASSERT_TRUE(received.ok());
  EXPECT_TRUE(SamePixels(received->grey, sent.grey));
}

TEST(ImageMessagesTest, AStampThatDoesNotFitIsABug) {
  Random random(3);
  Image image = RandomImage(4, 4, &random);
  image.stamp.ns = int64_t{1} << 62;
  EXPECT_THROW(ToWire(image), CheckFailure);
}

TEST(ImageMessagesTest, ColourImagesWithPaddedRowsTurnGrey) {
  cv::Mat bgr(5, 7, CV_8UC3);
  cv::randu(bgr, 0, 256);
  for (const std::string encoding : {"bgr8", "rgb8"}) {
    WireImage wire;
    wire.width(7);
    wire.height(5);
    wire.encoding(encoding);
    wire.step(7 * 3 + 2);
    wire.data().assign(5 * wire.step(), 99);
    for (int row = 0; row < 5; ++row)
      std::copy_n(bgr.ptr(row), 7 * 3, &wire.data()[static_cast<size_t>(row) * wire.step()]);
    cv::Mat expected;
    cv::cvtColor(bgr, expected, encoding == "bgr8" ? cv::COLOR_BGR2GRAY : cv::COLOR_RGB2GRAY);
    const Result<Image> received = FromWire(wire);
    ASSERT_TRUE(received.ok()) << received.error().message;
    EXPECT_TRUE(SamePixels(received->grey, expected));
  }
}

TEST(ImageMessagesTest, CompressedImagesAreDecoded) {
  Random random(4);
  const Image image = RandomImage(40, 30, &random);
  WireCompressed wire;
  wire.format("png");
  wire.header().stamp().sec(3);
  wire.header().stamp().nanosec(5);
  ASSERT_TRUE(cv::imencode(".png", image.grey, wire.data()));
  const Result<Image> png = FromWire(wire);
  ASSERT_TRUE(png.ok()) << png.error().message;
  EXPECT_EQ(png->stamp.ns, 3000000005);
  EXPECT_TRUE(SamePixels(png->grey, image.grey));

  ASSERT_TRUE(cv::imencode(".jpg", image.grey, wire.data()));
  const Result<Image> jpeg = FromWire(wire);
  ASSERT_TRUE(jpeg.ok());
  EXPECT_EQ(jpeg->grey.size(), image.grey.size());
}

TEST(ImageMessagesTest, RefusesMalformedImages) {
  const std::vector<Malformed<WireImage>> cases = {
      {"nanosec is 1000000000", [](WireImage* w) { w->header().stamp().nanosec(1000000000u); }},
      {"has no size", [](WireImage* w) { w->width(0); }},
      {"width is 4294967295", [](WireImage* w) { w->width(0xffffffffu); }},
      {"encoding", [](WireImage* w) { w->encoding("16UC1"); }},
      {"step is shorter", [](WireImage* w) { w->step(7); }},
      {"step is shorter", [](WireImage* w) { w->encoding("rgb8"); }},
      {"data has 63 bytes", [](WireImage* w) { w->data().pop_back(); }},
      {"data has 64 bytes", [](WireImage* w) { w->height(9); }},
  };
  Random random(5);
  const WireImage good = ToWire(RandomImage(8, 8, &random));
  ExpectRefused(good, cases);
}

TEST(ImageMessagesTest, RefusesCompressedImagesOfOtherFormatsAndBrokenOnes) {
  Random random(6);
  const Image image = RandomImage(40, 30, &random);
  WireCompressed wire;
  EXPECT_THAT(FromWire(wire).error().message, HasSubstr("neither JPEG nor PNG"));
  ASSERT_TRUE(cv::imencode(".bmp", image.grey, wire.data()));
  EXPECT_THAT(FromWire(wire).error().message, HasSubstr("neither JPEG nor PNG"));
  ASSERT_TRUE(cv::imencode(".png", image.grey, wire.data()));
  wire.data().resize(20);
  EXPECT_THAT(FromWire(wire).error().message, HasSubstr("can't be decoded"));
}

}  // namespace
}  // namespace portolan
