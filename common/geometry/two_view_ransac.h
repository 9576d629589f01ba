#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "base/random.h"
#include "geometry/two_view.h"

/// Shared by the estimation of fundamental matrices and homographies; not for use elsewhere.
namespace portolan::two_view_internal {

// Of a perfect match and direction: 95 % of a chi-square with 2 degrees of freedom.
inline constexpr double kReward = 5.99;
inline constexpr size_t kSampleSize = 8;       // drawn for either model, so that both see the same samples
inline constexpr int kMaxRefits = 10;          // to the inliers of the last fit, while their score grows
inline constexpr double kConfidence = 0.9999;  // that one sample was free of outliers, before the iterations end early

using Vector9d = Eigen::Matrix<double, 9, 1>;
using Matrix9d = Eigen::Matrix<double, 9, 9>;
using Sample = std::array<size_t, kSampleSize>;

/// Points shifted to mean 0 and scaled to mean distance sqrt(2) (Hartley and Zisserman, Sec. 4.4.4).
struct NormalizedPoints {
  explicit NormalizedPoints(const std::vector<Eigen::Vector2d>& pixels_px);
  std::vector<Eigen::Vector2d> points;
  Eigen::Matrix3d normalized_from_pixel;
};

/// The matrix whose rows follow each other in the vector.
Eigen::Matrix3d FromRowMajor(const Vector9d& v);

/// A unit vector orthogonal to the eight columns.
Vector9d NullVector(const Eigen::Matrix<double, 9, 8>& columns);

/// The unit vector v that makes v^T A v least; only A's lower triangle is read.
Vector9d SmallestEigenvector(const Matrix9d& A);

/// Equal numbers of finite pixels, at least `needed`; the message begins with the model's name.
Status CheckMatches(const PixelMatches& matches, size_t needed, const std::string& model);

/// Distinct indices below n; the first min(n, kSampleSize) entries count.
Sample DrawSample(size_t n, Random* random);

/// Sums the rewards kReward - error / variance of both directions of all matches, where the error is below chi2 *
/// variance.
/// @param errors errors(i) is the array of both squared errors of match i, pixels^2. @param inliers marked where not
/// null: both directions fit. @return the score, or 0 as soon as it can no longer exceed `to_beat`.
template <class Errors>
double TruncatedScore(size_t n, double sigma_px, double chi2, double to_beat, std::vector<bool>* inliers,
                      const Errors& errors) {
  const double variance = sigma_px * sigma_px, inverse_variance = 1 / variance, threshold = chi2 * variance;
  double score = 0;
  for (size_t i = 0; i < n; ++i) {
    const std::array<double, 2> e = errors(i);
    const bool first_fits = e[0] < threshold, second_fits = e[1] < threshold;  // false for NaN
    if (first_fits) score += kReward - e[0] * inverse_variance;
    if (second_fits) score += kReward - e[1] * inverse_variance;
    if (inliers != nullptr) (*inliers)[i] = first_fits && second_fits;
    if (score + 2 * kReward * static_cast<double>(n - i - 1) < to_beat) return 0;
  }
  return score;
}

inline size_t CountInliers(const std::vector<bool>& inliers) {
  return static_cast<size_t>(std::count(inliers.begin(), inliers.end(), true));
}

/// Refits to the inliers while the score grows (local optimisation; Chum, Matas and Kittler, DAGM 2003).
template <class Problem>
void Refit(const Problem& problem, TwoViewModel* model) {
  for (int i = 0; i < kMaxRefits && CountInliers(model->inliers) >= Problem::kMinMatches; ++i) {
    TwoViewModel refitted;
    refitted.second_from_first = problem.FitInliers(*model);
    refitted.inliers.resize(problem.size());
    refitted.score = problem.Score(refitted.second_from_first, 0, &refitted.inliers);
    if (!(refitted.score > model->score)) return;
    *model = std::move(refitted);
  }
}

/// RANSAC with local optimisation of every new best model, ended early once one sample without outliers is all but
/// certain. Problem has kMinMatches, size(), FitSample(sample), FitInliers(model) and Score(matrix, to_beat, inliers).
template <class Problem>
Result<TwoViewModel> RunRansac(const Problem& problem, const TwoViewOptions& options) {
  Random random(options.seed);
  TwoViewModel best;
  double iterations = options.ransac_iterations;
  for (int i = 0; i < iterations; ++i) {
    TwoViewModel model;
    model.second_from_first = problem.FitSample(DrawSample(problem.size(), &random));
    model.score = problem.Score(model.second_from_first, best.score, nullptr);
    if (!(model.score > best.score)) continue;
    model.inliers.resize(problem.size());
    problem.Score(model.second_from_first, 0, &model.inliers);
    Refit(problem, &model);
    best = std::move(model);
    const double share = static_cast<double>(CountInliers(best.inliers)) / static_cast<double>(problem.size());
    const double clean_sample = std::pow(share, static_cast<double>(Problem::kMinMatches));
    iterations =
        std::min(iterations, std::ceil(std::log(1 - kConfidence) / std::log1p(-std::min(clean_sample, kConfidence))));
  }
  if (best.score == 0) return Error{std::string(Problem::kName) + ": no sample of the matches agrees on a model"};
  return best;
}

}  // namespace portolan::two_view_internal
