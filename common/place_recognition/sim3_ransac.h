#pragma once

#include <cstdint>
#include <vector>

#include "base/result.h"
#include "optimization/sim3_optimization.h"

namespace portolan {

struct Sim3RansacOptions {
  int iterations = 300;       ///< triples at most: with 30 % right ones the odds of missing all are 1 in 3000
  double confidence = 0.999;  ///< that a triple of right matches was among those drawn: ends earlier
  double chi2 = 9.21;         ///< squared normalised error of an inlier on each side: 99 % with 2 degrees of freedom
  int min_inliers = 12;       ///< matches in agreement
  bool fix_scale = false;     ///< keeps scale 1
  uint64_t seed = 1;
};

struct Sim3Estimate {
  Sim3d b_from_a;
  int num_inliers = 0;
};

/// The similarity (paper Eq. 12) on which most matches agree: Horn's closed form on triples in RANSAC, inliers by the
/// reprojection error on both sides, each new best one refined on its inliers. Fails, in words, with fewer than
/// min_inliers in agreement. Deterministic for options.seed.
Result<Sim3Estimate> EstimateSim3(const std::vector<Sim3Match>& matches, const Sim3RansacOptions& options);

}  // namespace portolan
