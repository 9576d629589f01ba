#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <utility>
#include <vector>

#include "features/feature_grid.h"
#include "features/feature_set.h"

namespace portolan {

/// A match of feature `first` of one image with feature `second` of another.
struct FeatureMatch {
  uint32_t first = 0;
  uint32_t second = 0;
  int distance = 0;  ///< Hamming
};

struct MatcherOptions {
  int max_distance = 50;          ///< Hamming distance of a match, of 256 bits
  double ratio = 0.8;             ///< best over second best distance (Lowe's test), 1 to leave it out
  bool check_orientation = true;  ///< matches must agree on one rotation in the image plane (three fullest of 30 bins)
};

/// Features of an image by node of the vocabulary tree at the direct index's level: (node id, feature index), sorted.
/// Flat and narrow, as every keyframe has one and most nodes a feature or two: 4 bytes a feature, of which a table of
/// lists by node takes 50.
using NodeFeatures = std::vector<std::pair<uint16_t, uint16_t>>;

/// Matches features that share a vocabulary node (paper Sec. 2). One to one. `use_first(i)`, `use_second(j)` select
/// features; null uses all.
std::vector<FeatureMatch> MatchByNodes(const FeatureSet& first, const NodeFeatures& first_nodes,
                                       const FeatureSet& second, const NodeFeatures& second_nodes,
                                       const MatcherOptions& options, const std::function<bool(uint32_t)>& use_first,
                                       const std::function<bool(uint32_t)>& use_second);

/// Matches features near a predicted location: for each feature i of `first` with a finite predicted_px[i], the best
/// feature of `second` within radius_px and one octave of it. One to one (the closer descriptor wins).
/// @param predicted_px one per feature of `first`; NaN skips it.
std::vector<FeatureMatch> MatchByWindow(const FeatureSet& first, const std::vector<Eigen::Vector2d>& predicted_px,
                                        const FeatureSet& second, const FeatureGrid& second_grid, double radius_px,
                                        const MatcherOptions& options);

/// Drops matches whose difference of orientation is outside the three fullest of 30 bins (bins with under a tenth of
/// the fullest's count are outside too).
std::vector<FeatureMatch> KeepConsistentOrientation(const FeatureSet& first, const FeatureSet& second,
                                                    const std::vector<FeatureMatch>& matches);

}  // namespace portolan
