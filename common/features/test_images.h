#pragma once

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "base/random.h"
#include "geometry/camera_model.h"

namespace portolan {

/// A picture for tests: overlapping rectangles of random size, angle and grey level, a little blurred and noisy as a
/// camera's: corners all over. @return CV_8UC1.
inline cv::Mat TexturedImage(int width, int height, uint64_t seed) {
  Random random(seed);
  const auto uniform = [&](double low, double high) { return static_cast<float>(random.Uniform(low, high)); };
  cv::Mat image(height, width, CV_8UC1, cv::Scalar(128));
  const int num_rectangles = width * height / 50;  // several in each patch of a descriptor
  for (int i = 0; i < num_rectangles; ++i) {
    const cv::Point2f centre(uniform(0, width), uniform(0, height));
    const cv::Size2f size(uniform(4, 20), uniform(4, 20));
    const cv::RotatedRect rectangle(centre, size, uniform(0, 90));
    cv::Point2f corners[4];
    rectangle.points(corners);
    std::vector<cv::Point> polygon(corners, corners + 4);
    cv::fillConvexPoly(image, polygon, cv::Scalar(uniform(0, 256)), cv::LINE_AA);
  }
  cv::GaussianBlur(image, image, cv::Size(3, 3), 0.7);
  for (auto pixel = image.begin<uchar>(); pixel != image.end<uchar>(); ++pixel) {
    *pixel = cv::saturate_cast<uchar>(*pixel + random.Gaussian());
  }
  return image;
}

/// A camera without distortion for images of that size.
inline CameraModel PlainCamera(const cv::Mat& image) {
  CameraModel camera;
  camera.pinhole = {500, 500, image.cols / 2.0, image.rows / 2.0, image.cols, image.rows};
  return camera;
}

}  // namespace portolan
