#include "dataset/compressed_image.h"

#include <opencv2/imgcodecs.hpp>

#include "base/check.h"

namespace portolan {

CompressedImage CompressJpeg(const Image& image, int quality) {
  CompressedImage compressed;
  compressed.stamp = image.stamp;
  const bool encoded = cv::imencode(".jpg", image.grey, compressed.bytes, {cv::IMWRITE_JPEG_QUALITY, quality});
  PORTOLAN_CHECK(encoded) << "image of " << image.grey.cols << "x" << image.grey.rows;
  return compressed;
}

}  // namespace portolan
