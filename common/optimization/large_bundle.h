#pragma once

#include <atomic>

#include "optimization/bundle_adjustment.h"

namespace portolan {

/// AdjustBundle for whole maps: the same problem and loss, in half the time. Points are eliminated one at a time (Schur
/// complement, Triggs et al., Bundle Adjustment - A Modern Synthesis, 2000, Sec. 6), the reduced system of the free
/// poses is sparse, of 6x6 blocks, and factorised once a step (Gauss-Newton with Levenberg's and Marquardt's damping,
/// robust weights renewed each step, steps over-relaxed). Of large problems nothing is kept of a measurement from one
/// step to the next. Memory: the problem (48 bytes a measurement) and the factor (town_lap: 30 MB), against some 600
/// bytes a measurement with Ceres.
BundleSummary AdjustLargeBundle(BundleProblem* problem, const BundleOptions& options, const std::atomic<bool>* stop);

}  // namespace portolan
