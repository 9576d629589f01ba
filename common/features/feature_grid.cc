#include "features/feature_grid.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "base/check.h"

namespace portolan {
namespace {

/// Cell of a coordinate along one axis; those outside of the image go to the nearest cell.
int CellAlong(double coordinate_px, double cell_px, int cells) {
  return static_cast<int>(std::clamp(std::floor(coordinate_px / cell_px), 0.0, static_cast<double>(cells - 1)));
}

}  // namespace

FeatureGrid::FeatureGrid(const FeatureSet& features, int width, int height) {
  PORTOLAN_CHECK(width > 0 && height > 0) << width << "x" << height;
  PORTOLAN_CHECK(features.size() <= kMaxFeatures) << features.size() << " features";
  columns_ = static_cast<int>(std::ceil(width / kCellPx));
  rows_ = static_cast<int>(std::ceil(height / kCellPx));
  std::vector<size_t> cell_of(features.size());
  cell_begin_.assign(static_cast<size_t>(columns_ * rows_) + 1, 0);
  for (size_t i = 0; i < features.size(); ++i) {
    const Eigen::Vector2f& pixel_px = features.pixels_px[i];
    cell_of[i] = static_cast<size_t>(CellAlong(pixel_px.y(), kCellPx, rows_) * columns_ +
                                     CellAlong(pixel_px.x(), kCellPx, columns_));
    ++cell_begin_[cell_of[i] + 1];
  }
  std::partial_sum(cell_begin_.begin(), cell_begin_.end(), cell_begin_.begin());
  std::vector<uint16_t> next(cell_begin_.begin(), cell_begin_.end() - 1);
  indices_.resize(features.size());
  for (size_t i = 0; i < features.size(); ++i) indices_[next[cell_of[i]]++] = static_cast<uint16_t>(i);
}

void FeatureGrid::Find(const FeatureSet& features, const Eigen::Vector2d& centre_px, double radius_px, int min_octave,
                       int max_octave, std::vector<uint32_t>* found) const {
  if (indices_.empty() || !centre_px.allFinite() || radius_px < 0) return;
  PORTOLAN_CHECK(features.size() == indices_.size()) << features.size() << " features, grid of " << indices_.size();
  const Eigen::Vector2d low = centre_px.array() - radius_px, high = centre_px.array() + radius_px;
  const int first_column = CellAlong(low.x(), kCellPx, columns_), last_column = CellAlong(high.x(), kCellPx, columns_);
  const int first_row = CellAlong(low.y(), kCellPx, rows_), last_row = CellAlong(high.y(), kCellPx, rows_);
  for (int row = first_row; row <= last_row; ++row) {
    const size_t first_cell = static_cast<size_t>(row * columns_ + first_column);
    const size_t last_cell = static_cast<size_t>(row * columns_ + last_column);
    for (uint32_t slot = cell_begin_[first_cell]; slot < cell_begin_[last_cell + 1]; ++slot) {
      const uint32_t i = indices_[slot];
      const int octave = features.octaves[i];
      if (octave < min_octave || octave > max_octave) continue;
      const Eigen::Vector2d offset = features.pixels_px[i].cast<double>() - centre_px;
      if (offset.cwiseAbs().maxCoeff() <= radius_px) found->push_back(i);
    }
  }
}

}  // namespace portolan
