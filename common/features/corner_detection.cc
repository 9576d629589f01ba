#include "features/corner_detection.h"

#include <algorithm>

#include "base/check.h"

namespace portolan {
namespace {

constexpr int kFastRadius = FastCorners::kRadius;

/// Number of cells of about cell_px along a length: at least one.
int CountCells(int length, int cell_px) {
  return std::max(1, (length + cell_px / 2) / cell_px);
}

}  // namespace

CornerDetector::CornerDetector(int threshold, int min_threshold, int cell_px, int border_px)
    : threshold_(threshold), min_threshold_(min_threshold), cell_px_(cell_px), border_px_(border_px) {
  PORTOLAN_CHECK(cell_px_ > 0);
  PORTOLAN_CHECK(border_px_ >= kFastRadius);
}

const std::vector<Corner>& CornerDetector::Detect(const cv::Mat& level) {
  corners_.clear();
  const cv::Rect area(border_px_, border_px_, level.cols - 2 * border_px_, level.rows - 2 * border_px_);
  if (area.width <= 0 || area.height <= 0) return corners_;
  DetectInside(level, area, threshold_);
  if (min_threshold_ < threshold_) SearchEmptyCells(level, area);
  return corners_;
}

void CornerDetector::DetectInside(const cv::Mat& level, const cv::Rect& area, int threshold) {
  const cv::Rect padded(area.x - kFastRadius, area.y - kFastRadius, area.width + 2 * kFastRadius,
                        area.height + 2 * kFastRadius);
  const size_t before = corners_.size();
  fast_.Find(level(padded), threshold, &corners_);
  for (size_t i = before; i < corners_.size(); ++i) {
    corners_[i].x += padded.x;
    corners_[i].y += padded.y;
  }
}

void CornerDetector::SearchEmptyCells(const cv::Mat& level, const cv::Rect& area) {
  const int columns = CountCells(area.width, cell_px_), rows = CountCells(area.height, cell_px_);
  is_occupied_.assign(static_cast<size_t>(columns * rows), 0);
  for (const Corner& corner : corners_) {
    const int column = (corner.x - area.x) * columns / area.width, row = (corner.y - area.y) * rows / area.height;
    is_occupied_[static_cast<size_t>(row * columns + column)] = 1;
  }
  // First pixel of a cell: the smallest x with x * columns / width == column, so that cells and counts above agree.
  const auto begin = [](int cell, int cells, int length) { return (cell * length + cells - 1) / cells; };
  for (int row = 0; row < rows; ++row) {
    const uint8_t* is_occupied = &is_occupied_[static_cast<size_t>(row * columns)];
    const int top = begin(row, rows, area.height), bottom = begin(row + 1, rows, area.height);
    for (int column = 0; column < columns;) {
      if (is_occupied[column]) {
        ++column;
        continue;
      }
      int end = column;  // a run of empty cells is searched in one piece: a call costs as much as several cells
      while (end < columns && !is_occupied[end]) ++end;
      const int left = begin(column, columns, area.width), right = begin(end, columns, area.width);
      DetectInside(level, cv::Rect(area.x + left, area.y + top, right - left, bottom - top), min_threshold_);
      column = end;
    }
  }
}

}  // namespace portolan
