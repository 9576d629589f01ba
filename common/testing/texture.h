#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

namespace portolan {

/// A grey picture with its mip levels, repeated without end in both directions. Immutable, thread-safe.
/// Source: Williams, Pyramidal parametrics, SIGGRAPH 1983.
class Texture {
 public:
  /// @param picture CV_8UC1; both sides powers of two.
  explicit Texture(const cv::Mat& picture);

  /// Grey value, 0 to 255, filtered over a footprint (an isotropic one of 2^level texels): trilinear.
  /// @param u, v  in widths and heights of the picture; (0, 0) is its top-left corner. @param level clamped to the
  /// levels there are.
  float Sample(double u, double v, float level) const;

  int width() const { return levels_[0].width; }
  int height() const { return levels_[0].height; }

 private:
  struct Level {
    int width, height;
    std::vector<uint8_t> texels;  // height rows of width
  };
  static float Bilinear(const Level& level, double u, double v);
  std::vector<Level> levels_;  // from full size down to a side of 1
};

}  // namespace portolan
