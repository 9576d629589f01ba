#include "features/corner_spread.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace portolan {
namespace {

/// Halvings of the search for the cell size: from a range of about 5 octaves to steps of 1.5 %.
constexpr int kSearchSteps = 8;

/// Puts corners into square cells and remembers the strongest of each.
class StrongestPerCell {
 public:
  StrongestPerCell(const std::vector<Corner>& corners, int width, int height)
      : corners_(corners), width_(width), height_(height) {}

  /// Number of occupied cells of the given side.
  int CountOccupied(double cell_px) {
    StartCells(cell_px);
    int occupied = 0;
    for (const Corner& corner : corners_) {
      int32_t& cell = cells_[CellOf(corner)];
      occupied += cell < 0;
      cell = 0;
    }
    return occupied;
  }

  /// The strongest corner of each occupied cell, of equals the first; in order of cells.
  std::vector<uint32_t> Select(double cell_px) {
    StartCells(cell_px);
    for (size_t i = 0; i < corners_.size(); ++i) {
      int32_t& cell = cells_[CellOf(corners_[i])];
      if (cell < 0 || corners_[i].score > corners_[static_cast<size_t>(cell)].score) cell = static_cast<int32_t>(i);
    }
    std::vector<uint32_t> selected;
    for (int32_t cell : cells_) {
      if (cell >= 0) selected.push_back(static_cast<uint32_t>(cell));
    }
    return selected;
  }

 private:
  void StartCells(double cell_px) {
    per_px_ = static_cast<float>(1.0 / cell_px);
    columns_ = static_cast<size_t>(static_cast<float>(width_) * per_px_) + 1;
    const size_t rows = static_cast<size_t>(static_cast<float>(height_) * per_px_) + 1;
    cells_.assign(columns_ * rows, -1);
  }
  size_t CellOf(const Corner& corner) const {
    const auto column = static_cast<size_t>(static_cast<float>(corner.x) * per_px_);
    return static_cast<size_t>(static_cast<float>(corner.y) * per_px_) * columns_ + column;
  }

  const std::vector<Corner>& corners_;
  const int width_, height_;
  float per_px_ = 0;
  size_t columns_ = 0;
  std::vector<int32_t> cells_;  // index of a corner, -1 for none
};

/// The largest cell size, within the steps of the search, that leaves at least `count` cells occupied.
double FindCellSize(StrongestPerCell* cells, double area_px, int count) {
  double small = 1.0;                               // a cell per pixel: every corner in its own
  double large = 2.0 * std::sqrt(area_px / count);  // a quarter of the cells needed
  for (int step = 0; step < kSearchSteps; ++step) {
    const double middle = std::sqrt(small * large);
    (cells->CountOccupied(middle) >= count ? small : large) = middle;
  }
  return small;
}

}  // namespace

std::vector<uint32_t> SpreadCorners(const std::vector<Corner>& corners, int width, int height, int count) {
  if (count <= 0) return {};
  std::vector<uint32_t> selected;
  if (corners.size() <= static_cast<size_t>(count)) {
    selected.resize(corners.size());
    std::iota(selected.begin(), selected.end(), 0u);
    return selected;
  }
  StrongestPerCell cells(corners, width, height);
  selected = cells.Select(FindCellSize(&cells, static_cast<double>(width) * height, count));
  const auto is_stronger = [&](uint32_t a, uint32_t b) {
    return corners[a].score != corners[b].score ? corners[a].score > corners[b].score : a < b;
  };
  const size_t kept = std::min(selected.size(), static_cast<size_t>(count));
  std::nth_element(selected.begin(), selected.begin() + static_cast<ptrdiff_t>(kept), selected.end(), is_stronger);
  selected.resize(kept);
  std::sort(selected.begin(), selected.end());
  return selected;
}

}  // namespace portolan
