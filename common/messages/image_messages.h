#pragma once

#include "base/result.h"
#include "dataset/compressed_image.h"
#include "dataset/image_source.h"
#include "messages/wire.h"

namespace portolan {

/// A grey image in ROS 2's form, encoding mono8. ROS has no frame numbers: the number is not sent. Its stamps have 32
/// bits for the seconds: a stamp before 1901 or after 2038 fails a check. @param frame_id names the camera; free.
sensor_msgs::msg::dds_::Image_ ToWire(const Image& image, const std::string& frame_id = "camera");

/// The same for JPEG images.
sensor_msgs::msg::dds_::CompressedImage_ ToWire(const CompressedImage& image, const std::string& frame_id = "camera");

/// mono8, rgb8 or bgr8; rows may be padded (`step`). Frame number 0: the receiver counts.
Result<Image> FromWire(const sensor_msgs::msg::dds_::Image_& wire);
/// JPEG or PNG, any colours, of a size that DecodeGrey takes.
Result<Image> FromWire(const sensor_msgs::msg::dds_::CompressedImage_& wire);

}  // namespace portolan
