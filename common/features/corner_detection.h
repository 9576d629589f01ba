#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "features/fast_corners.h"

namespace portolan {

/// Finds the corners of an image all over it.
///
/// The whole image is searched once at a high threshold. Cells that come out empty, as in shade or on bare walls, are
/// searched again at a low one: the low threshold on the whole image would cost twice the time where there is texture
/// anyway. Deterministic. Keeps its buffers between calls: one object per thread.
class CornerDetector {
 public:
  /// @param threshold, min_threshold grey levels. @param cell_px side of the cells that must not stay empty.
  /// @param border_px distance of corners from the image's border, at least 3 (FAST's circle).
  CornerDetector(int threshold, int min_threshold, int cell_px, int border_px);

  /// @param level CV_8UC1 of any size; one without room inside the border has no corners.
  /// @return corners, valid until the next call.
  const std::vector<Corner>& Detect(const cv::Mat& level);

 private:
  void DetectInside(const cv::Mat& level, const cv::Rect& area, int threshold);
  void SearchEmptyCells(const cv::Mat& level, const cv::Rect& area);

  const int threshold_, min_threshold_, cell_px_, border_px_;
  FastCorners fast_;
  std::vector<Corner> corners_;
  std::vector<uint8_t> is_occupied_;
};

}  // namespace portolan
