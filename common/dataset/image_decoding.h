#pragma once

#include <cstddef>
#include <cstdint>
#include <opencv2/core/mat.hpp>

#include "base/result.h"

namespace portolan {

/// Decodes an image file's bytes as CV_8UC1: 16-bit images are scaled down, colour becomes luminance. JPEG and PNG are
/// read by their own libraries, with the same values as cv::imdecode(IMREAD_GRAYSCALE) gives; other formats, JPEGs of
/// unusual colour spaces or with an EXIF header (orientation) by OpenCV's codecs, which are loaded for them. Fails with
/// what is wrong, or with "is not an image that can be decoded". JPEGs and PNGs of more than 33 megapixels, or a side
/// of more than 16384, are refused by their header.
Result<cv::Mat> DecodeGrey(const uint8_t* bytes, size_t size);

}  // namespace portolan
