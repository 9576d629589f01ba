#pragma once

#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "base/result.h"

namespace portolan {

/// Whether the name ends as an image's does: jpg, jpeg, png, pgm, ppm, bmp, tif, tiff, in any case.
bool HasImageExtension(const std::string& path);

/// Paths of the image files in a folder (not below it), ordered by name with numbers by value: 2.jpg before 10.jpg.
/// None if the folder can't be read.
std::vector<std::string> ListImageFiles(const std::string& folder);

/// Reads an image file as CV_8UC1 (16-bit images are scaled down, colour is converted by OpenCV). Fails, naming the
/// file: missing, empty, cut short (a JPEG without its end marker, a PNG without IEND: OpenCV would fill the rest with
/// grey), not an image.
Result<cv::Mat> ReadGreyImage(const std::string& path);

}  // namespace portolan
