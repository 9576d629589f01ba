#include "testing/texture.h"

#include <algorithm>
#include <opencv2/imgproc.hpp>

#include "base/check.h"

namespace portolan {
namespace {

bool IsPowerOfTwo(int n) {
  return n > 0 && (n & (n - 1)) == 0;
}

}  // namespace

Texture::Texture(const cv::Mat& picture) {
  PORTOLAN_CHECK(picture.type() == CV_8UC1 && IsPowerOfTwo(picture.cols) && IsPowerOfTwo(picture.rows))
      << " a texture of type " << picture.type() << ", " << picture.cols << " x " << picture.rows;
  cv::Mat level = picture.clone();
  while (true) {
    levels_.push_back({level.cols, level.rows, std::vector<uint8_t>(level.datastart, level.dataend)});
    if (level.cols == 1 || level.rows == 1) break;
    cv::Mat half;
    cv::resize(level, half, cv::Size(level.cols / 2, level.rows / 2), 0, 0, cv::INTER_AREA);
    level = half;
  }
}

float Texture::Bilinear(const Level& level, double u, double v) {
  // Texel (0, 0) has its centre half a texel inside the picture.
  const double x = u * level.width - 0.5, y = v * level.height - 0.5;
  const int64_t x_floor = static_cast<int64_t>(x) - (x < 0), y_floor = static_cast<int64_t>(y) - (y < 0);
  const float a = static_cast<float>(x - static_cast<double>(x_floor));
  const float b = static_cast<float>(y - static_cast<double>(y_floor));
  const int64_t mask_x = level.width - 1, mask_y = level.height - 1;
  const uint8_t* row0 = &level.texels[static_cast<size_t>((y_floor & mask_y) * level.width)];
  const uint8_t* row1 = &level.texels[static_cast<size_t>(((y_floor + 1) & mask_y) * level.width)];
  const int64_t x0 = x_floor & mask_x, x1 = (x_floor + 1) & mask_x;
  const float top = row0[x0] + a * static_cast<float>(row0[x1] - row0[x0]);
  const float bottom = row1[x0] + a * static_cast<float>(row1[x1] - row1[x0]);
  return top + b * (bottom - top);
}

float Texture::Sample(double u, double v, float level) const {
  const float last = static_cast<float>(levels_.size() - 1);
  const float clamped = std::clamp(level, 0.0f, last);
  const size_t fine = static_cast<size_t>(clamped);
  const float weight = clamped - static_cast<float>(fine);
  const float value = Bilinear(levels_[fine], u, v);
  if (weight == 0.0f) return value;
  return value + weight * (Bilinear(levels_[fine + 1], u, v) - value);
}

}  // namespace portolan
