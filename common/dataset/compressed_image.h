#pragma once

#include <cstdint>
#include <vector>

#include "base/time.h"
#include "dataset/image_source.h"

namespace portolan {

/// An image as the bytes of a JPEG or PNG file.
struct CompressedImage {
  Timestamp stamp;  ///< camera's clock
  std::vector<uint8_t> bytes;
};

/// Default quality of JPEG images: artefacts stay below the noise of a sensor.
constexpr int kJpegQuality = 95;

/// @param image with pixels. @param quality 0 to 100.
CompressedImage CompressJpeg(const Image& image, int quality = kJpegQuality);

}  // namespace portolan
