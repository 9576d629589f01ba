#include "messages/image_messages.h"

#include <cstring>
#include <opencv2/imgproc.hpp>

#include "base/check.h"
#include "dataset/image_decoding.h"
#include "messages/limits.h"
#include "messages/message_check.h"

namespace portolan {
namespace {

constexpr int64_t kNanosecondsPerSecond = 1000000000;

Timestamp StampFromWire(const builtin_interfaces::msg::dds_::Time_& time) {
  return Timestamp{int64_t{time.sec()} * kNanosecondsPerSecond + time.nanosec()};
}

std_msgs::msg::dds_::Header_ MakeHeader(Timestamp stamp, const std::string& frame_id) {
  int64_t seconds = stamp.ns / kNanosecondsPerSecond;
  int64_t nanoseconds = stamp.ns % kNanosecondsPerSecond;
  if (nanoseconds < 0) {  // nanosec counts forward, also before 1970
    --seconds;
    nanoseconds += kNanosecondsPerSecond;
  }
  PORTOLAN_CHECK(seconds >= INT32_MIN && seconds <= INT32_MAX) << "stamp " << stamp.ns << " ns does not fit ROS 2's";
  std_msgs::msg::dds_::Header_ header;
  header.stamp().sec(static_cast<int32_t>(seconds));
  header.stamp().nanosec(static_cast<uint32_t>(nanoseconds));
  header.frame_id(frame_id);
  return header;
}

void CheckHeader(const std_msgs::msg::dds_::Header_& header, MessageCheck* check) {
  check->AtMost("header.stamp.nanosec", header.stamp().nanosec(), kNanosecondsPerSecond - 1);
}

/// Channels of an encoding that can be read, 0 for others.
int NumChannels(const std::string& encoding) {
  if (encoding == "mono8") return 1;
  if (encoding == "rgb8" || encoding == "bgr8") return 3;
  return 0;
}

cv::Mat ToGrey(const cv::Mat& pixels, const std::string& encoding) {
  if (encoding == "mono8") return pixels.clone();
  cv::Mat grey;
  cv::cvtColor(pixels, grey, encoding == "rgb8" ? cv::COLOR_RGB2GRAY : cv::COLOR_BGR2GRAY);
  return grey;
}

/// True for what begins like a JPEG or PNG file: other formats that OpenCV reads are not let in from the network.
bool IsJpegOrPng(const std::vector<uint8_t>& data) {
  static constexpr uint8_t kJpeg[] = {0xff, 0xd8, 0xff};
  static constexpr uint8_t kPng[] = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'};
  return (data.size() > sizeof kJpeg && std::memcmp(data.data(), kJpeg, sizeof kJpeg) == 0) ||
         (data.size() > sizeof kPng && std::memcmp(data.data(), kPng, sizeof kPng) == 0);
}

}  // namespace

sensor_msgs::msg::dds_::Image_ ToWire(const Image& image, const std::string& frame_id) {
  PORTOLAN_CHECK(image.grey.type() == CV_8UC1) << "type " << image.grey.type();
  sensor_msgs::msg::dds_::Image_ wire;
  wire.header(MakeHeader(image.stamp, frame_id));
  wire.height(static_cast<uint32_t>(image.grey.rows));
  wire.width(static_cast<uint32_t>(image.grey.cols));
  wire.encoding("mono8");
  wire.is_bigendian(0);
  wire.step(static_cast<uint32_t>(image.grey.cols));
  const size_t row_bytes = static_cast<size_t>(image.grey.cols);
  wire.data().resize(row_bytes * static_cast<size_t>(image.grey.rows));
  for (int row = 0; row < image.grey.rows; ++row) {
    std::memcpy(wire.data().data() + static_cast<size_t>(row) * row_bytes, image.grey.ptr(row), row_bytes);
  }
  return wire;
}

sensor_msgs::msg::dds_::CompressedImage_ ToWire(const CompressedImage& image, const std::string& frame_id) {
  sensor_msgs::msg::dds_::CompressedImage_ wire;
  wire.header(MakeHeader(image.stamp, frame_id));
  wire.format("jpeg");
  wire.data(image.bytes);
  return wire;
}

Result<Image> FromWire(const sensor_msgs::msg::dds_::Image_& wire) {
  MessageCheck check("Image");
  CheckHeader(wire.header(), &check);
  check.Require(wire.width() > 0 && wire.height() > 0, "has no size");
  check.AtMost("width", wire.width(), kMaxImageSide);
  check.AtMost("height", wire.height(), kMaxImageSide);
  const int channels = NumChannels(wire.encoding());
  check.Require(channels > 0, "encoding is not mono8, rgb8 or bgr8");
  check.Require(wire.step() >= uint64_t{wire.width()} * static_cast<uint64_t>(channels), "step is shorter than a row");
  check.Require(wire.data().size() == uint64_t{wire.step()} * wire.height(),
                "data has " + std::to_string(wire.data().size()) + " bytes, step x height expected");
  if (!check.ok()) return check.error();

  const cv::Mat pixels(static_cast<int>(wire.height()), static_cast<int>(wire.width()), CV_8UC(channels),
                       const_cast<uint8_t*>(wire.data().data()), wire.step());  // read only
  return Image{0, StampFromWire(wire.header().stamp()), ToGrey(pixels, wire.encoding())};
}

Result<Image> FromWire(const sensor_msgs::msg::dds_::CompressedImage_& wire) {
  MessageCheck check("CompressedImage");
  CheckHeader(wire.header(), &check);
  check.AtMost("bytes", wire.data().size(), kMaxCompressedImageBytes);
  check.Require(IsJpegOrPng(wire.data()), "data is neither JPEG nor PNG");
  if (!check.ok()) return check.error();

  const Result<cv::Mat> grey = DecodeGrey(wire.data().data(), wire.data().size());
  if (!grey) return Error{"CompressedImage: " + grey.error().message};
  return Image{0, StampFromWire(wire.header().stamp()), *grey};
}

}  // namespace portolan
