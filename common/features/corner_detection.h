#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <opencv2/features2d.hpp>
#include <vector>

namespace portolan {

/// A FAST corner of one pyramid level.
struct Corner {
  int x = 0, y = 0;  ///< pixel of the level
  float score = 0;   ///< largest threshold at which it is a corner, grey levels
};

/// Finds the FAST-9 corners of an image (Rosten and Drummond, ECCV 2006), with non-maximum suppression.
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
  std::vector<cv::KeyPoint> keypoints_;
  std::vector<Corner> corners_;
  std::vector<uint8_t> is_occupied_;
};

}  // namespace portolan
