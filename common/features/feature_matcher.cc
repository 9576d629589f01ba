#include "features/feature_matcher.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <numeric>

#include "base/check.h"

namespace portolan {
namespace {

/// Features of two octaves this close are taken for one corner seen on two levels, whose descriptors are bound to be
/// alike: they are no rivals in the ratio test. About the distance between such locations (one pixel of a coarse
/// level), level 0 pixels.
constexpr float kSameCornerPx = 4.0f;

constexpr int kOrientationBins = 30;  // of 12 degrees each
constexpr int kBinsKept = 3;
constexpr double kMinShareOfFullest = 0.1;

bool AreOneCorner(const FeatureSet& features, uint32_t a, uint32_t b) {
  return features.octaves[a] != features.octaves[b] &&
         (features.pixels_px[a] - features.pixels_px[b]).squaredNorm() < kSameCornerPx * kSameCornerPx;
}

/// Collects matches one to one: of the features of the first image that want one feature of the second, the closest
/// gets it.
class OneToOne {
 public:
  OneToOne(const FeatureSet& first, const FeatureSet& second, const MatcherOptions& options)
      : first_(first), second_(second), options_(options), owner_(second.size(), FeatureMatch{0, 0, kNobody}) {}

  /// Looks for the match of feature i among candidates of the second image; of equal distances the first one counts.
  void MatchFeature(uint32_t i, const std::vector<uint32_t>& candidates) {
    distances_.clear();
    size_t best = 0;
    for (size_t c = 0; c < candidates.size(); ++c) {
      distances_.push_back(HammingDistance(first_.descriptors[i], second_.descriptors[candidates[c]]));
      if (distances_[c] < distances_[best]) best = c;
    }
    if (candidates.empty() || distances_[best] > options_.max_distance || HasRival(candidates, best)) return;
    FeatureMatch& owner = owner_[candidates[best]];
    if (owner.distance <= distances_[best]) return;
    owner = {i, candidates[best], distances_[best]};
  }

  /// The matches by index in the first image, after the check of orientations if asked for.
  std::vector<FeatureMatch> Finish() const {
    std::vector<FeatureMatch> matches;
    for (const FeatureMatch& owner : owner_) {
      if (owner.distance != kNobody) matches.push_back(owner);
    }
    std::sort(matches.begin(), matches.end(),
              [](const FeatureMatch& a, const FeatureMatch& b) { return a.first < b.first; });
    return options_.check_orientation ? KeepConsistentOrientation(first_, second_, matches) : matches;
  }

 private:
  static constexpr int kNobody = 257;  // farther than any descriptor

  /// Lowe's ratio test: whether another corner is about as close as the best.
  bool HasRival(const std::vector<uint32_t>& candidates, size_t best) const {
    if (options_.ratio >= 1) return false;
    for (size_t c = 0; c < candidates.size(); ++c) {
      if (c == best || distances_[best] < options_.ratio * distances_[c]) continue;
      if (!AreOneCorner(second_, candidates[best], candidates[c])) return true;
    }
    return false;
  }

  const FeatureSet& first_;
  const FeatureSet& second_;
  const MatcherOptions& options_;
  std::vector<FeatureMatch> owner_;  // per feature of the second image
  std::vector<int> distances_;       // of the candidates at hand
};

/// Bin of the rotation from `first` to `second`; bin 0 is centred on no rotation.
size_t RotationBin(float first_rad, float second_rad) {
  const double turns = (static_cast<double>(second_rad) - first_rad) / (2 * M_PI);
  const auto bin = static_cast<int>(std::lround((turns - std::floor(turns)) * kOrientationBins));
  return static_cast<size_t>(bin % kOrientationBins);
}

}  // namespace

std::vector<FeatureMatch> MatchByNodes(const FeatureSet& first, const NodeFeatures& first_nodes,
                                       const FeatureSet& second, const NodeFeatures& second_nodes,
                                       const MatcherOptions& options, const std::function<bool(uint32_t)>& use_first,
                                       const std::function<bool(uint32_t)>& use_second) {
  OneToOne matches(first, second, options);
  std::vector<uint32_t> candidates;  // of the second image in the node at hand
  auto next_second = second_nodes.begin();
  for (auto next_first = first_nodes.begin(); next_first != first_nodes.end();) {
    const uint32_t node = next_first->first;
    while (next_second != second_nodes.end() && next_second->first < node) ++next_second;
    candidates.clear();
    for (; next_second != second_nodes.end() && next_second->first == node; ++next_second) {
      if (!use_second || use_second(next_second->second)) candidates.push_back(next_second->second);
    }
    for (; next_first != first_nodes.end() && next_first->first == node; ++next_first) {
      if (!use_first || use_first(next_first->second)) matches.MatchFeature(next_first->second, candidates);
    }
  }
  return matches.Finish();
}

std::vector<FeatureMatch> MatchByWindow(const FeatureSet& first, const std::vector<Eigen::Vector2d>& predicted_px,
                                        const FeatureSet& second, const FeatureGrid& second_grid, double radius_px,
                                        const MatcherOptions& options) {
  PORTOLAN_CHECK(predicted_px.size() == first.size())
      << predicted_px.size() << " predictions, " << first.size() << " features";
  OneToOne matches(first, second, options);
  std::vector<uint32_t> candidates;
  for (uint32_t i = 0; i < first.size(); ++i) {
    candidates.clear();
    const int octave = first.octaves[i];
    second_grid.Find(second, predicted_px[i], radius_px, octave - 1, octave + 1, &candidates);
    matches.MatchFeature(i, candidates);
  }
  return matches.Finish();
}

std::vector<FeatureMatch> KeepConsistentOrientation(const FeatureSet& first, const FeatureSet& second,
                                                    const std::vector<FeatureMatch>& matches) {
  std::array<int, kOrientationBins> counts{};
  const auto bin_of = [&](const FeatureMatch& match) {
    return RotationBin(first.angles_rad[match.first], second.angles_rad[match.second]);
  };
  for (const FeatureMatch& match : matches) ++counts[bin_of(match)];
  std::array<size_t, kOrientationBins> fullest_first;
  std::iota(fullest_first.begin(), fullest_first.end(), size_t{0});
  std::stable_sort(fullest_first.begin(), fullest_first.end(),
                   [&](size_t a, size_t b) { return counts[a] > counts[b]; });
  std::array<bool, kOrientationBins> is_kept{};
  for (int rank = 0; rank < kBinsKept; ++rank) {
    const size_t bin = fullest_first[static_cast<size_t>(rank)];
    is_kept[bin] = counts[bin] >= kMinShareOfFullest * counts[fullest_first[0]];
  }
  std::vector<FeatureMatch> kept;
  std::copy_if(matches.begin(), matches.end(), std::back_inserter(kept),
               [&](const FeatureMatch& match) { return is_kept[bin_of(match)]; });
  return kept;
}

}  // namespace portolan
