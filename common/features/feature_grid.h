#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "features/feature_set.h"

namespace portolan {

/// Features of one image by location, for window searches. Immutable after construction. At most kMaxFeatures, so that
/// each takes 2 bytes: every keyframe of a mapper has one.
class FeatureGrid {
 public:
  static constexpr size_t kMaxFeatures = 65535;

  FeatureGrid() = default;
  /// @param width, height of the image, pixels.
  FeatureGrid(const FeatureSet& features, int width, int height);

  /// Appends to `found` (not cleared) the indices of features within the square of half-side radius_px around centre_px
  /// and with octave in [min_octave, max_octave], in ascending order of grid cell, then of index.
  void Find(const FeatureSet& features, const Eigen::Vector2d& centre_px, double radius_px, int min_octave,
            int max_octave, std::vector<uint32_t>* found) const;

 private:
  static constexpr double kCellPx = 16.0;
  int columns_ = 0, rows_ = 0;
  std::vector<uint16_t> cell_begin_;  // columns_ * rows_ + 1 offsets into indices_
  std::vector<uint16_t> indices_;
};

}  // namespace portolan
