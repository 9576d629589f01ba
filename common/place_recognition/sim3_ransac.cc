#include "place_recognition/sim3_ransac.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "base/random.h"
#include "geometry/sim3_alignment.h"

namespace portolan {
namespace {

constexpr size_t kSample = 3;
/// A hypothesis with so few inliers is not worth refining: a triple explains itself.
constexpr int kMinToRefine = 6;

std::array<size_t, kSample> DrawSample(size_t n, Random* random) {
  std::array<size_t, kSample> sample{};
  for (size_t i = 0; i < kSample;) {
    sample[i] = static_cast<size_t>(random->Below(n));
    const bool is_new = std::find(sample.begin(), sample.begin() + i, sample[i]) == sample.begin() + i;
    if (is_new) ++i;
  }
  return sample;
}

/// Triples to draw until one of right matches alone is among them, with the confidence asked for.
int IterationsFor(double inlier_share, const Sim3RansacOptions& options) {
  const double right = inlier_share * inlier_share * inlier_share;
  if (right >= 1) return 1;
  const double needed = std::log(1 - options.confidence) / std::log1p(-right);
  return needed < options.iterations ? static_cast<int>(std::ceil(needed)) : options.iterations;
}

class Ransac {
 public:
  Ransac(const std::vector<Sim3Match>& matches, const Sim3RansacOptions& options)
      : matches_(matches), options_(options), random_(options.seed) {}

  Sim3Estimate Run() {
    int needed = options_.iterations;
    for (int i = 0; i < needed; ++i) {
      const Result<Sim3d> hypothesis = Hypothesis();
      if (!hypothesis) continue;
      const int count = CountInliers(*hypothesis);
      if (count <= best_of_triples_) continue;
      best_of_triples_ = count;
      Keep({*hypothesis, count});
      if (count >= kMinToRefine) Keep(Refine(*hypothesis));
      needed = IterationsFor(static_cast<double>(best_.num_inliers) / static_cast<double>(matches_.size()), options_);
    }
    return best_;
  }

 private:
  Result<Sim3d> Hypothesis() {
    std::vector<Eigen::Vector3d> in_a, in_b;
    for (const size_t i : DrawSample(matches_.size(), &random_)) {
      in_a.push_back(matches_[i].point_in_a);
      in_b.push_back(matches_[i].point_in_b);
    }
    return AlignPoints(in_a, in_b, options_.fix_scale);
  }

  int CountInliers(const Sim3d& b_from_a) const {
    return static_cast<int>(std::count_if(matches_.begin(), matches_.end(), [&](const Sim3Match& match) {
      return Chi2Of(match, b_from_a) <= options_.chi2;
    }));
  }

  /// A triple carries the errors of its three landmarks; all of its inliers together know better.
  Sim3Estimate Refine(const Sim3d& b_from_a) const {
    std::vector<Sim3Match> inliers;
    for (const Sim3Match& match : matches_) {
      if (Chi2Of(match, b_from_a) <= options_.chi2) inliers.push_back(match);
    }
    Sim3OptimizationOptions refinement;
    refinement.fix_scale = options_.fix_scale;
    refinement.rounds = 1;
    refinement.iterations = 5;
    const Sim3d refined = OptimizeSim3(inliers, b_from_a, refinement).b_from_a;
    return {refined, CountInliers(refined)};
  }

  void Keep(const Sim3Estimate& estimate) {
    if (estimate.num_inliers > best_.num_inliers) best_ = estimate;
  }

  const std::vector<Sim3Match>& matches_;
  const Sim3RansacOptions& options_;
  Random random_;
  int best_of_triples_ = 0;
  Sim3Estimate best_;
};

}  // namespace

Result<Sim3Estimate> EstimateSim3(const std::vector<Sim3Match>& matches, const Sim3RansacOptions& options) {
  const int at_least = std::max(options.min_inliers, static_cast<int>(kSample));
  if (static_cast<int>(matches.size()) < at_least)
    return Error{fmt::format("RANSAC: {} matches, expected {}", matches.size(), at_least)};
  const Sim3Estimate best = Ransac(matches, options).Run();
  if (best.num_inliers < at_least)
    return Error{fmt::format("RANSAC: {} inliers of {}, expected {}", best.num_inliers, matches.size(), at_least)};
  return best;
}

}  // namespace portolan
