#include <Eigen/Eigenvalues>
#include <Eigen/LU>

#include "geometry/two_view.h"
#include "geometry/two_view_ransac.h"

namespace portolan {
namespace {

using two_view_internal::Matrix9d;
using two_view_internal::NormalizedPoints;
using two_view_internal::Sample;
using two_view_internal::Vector9d;

constexpr double kChi2 = 3.84;  // 95 % of a chi-square with 1 degree of freedom: distance of a point from a line

/// A match's equation x2^T F x1 = 0 for the row-major F (Hartley and Zisserman, Eq. 11.2).
Vector9d Row(const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
  Vector9d row;
  row << b.x() * a.x(), b.x() * a.y(), b.x(), b.y() * a.x(), b.y() * a.y(), b.y(), a.x(), a.y(), 1;
  return row;
}

/// A match's weight in the next linear fit, from the last F: with it, the algebraic error becomes Sampson's
/// approximation of the geometric one (Hartley and Zisserman, Eq. 11.9).
double SampsonWeight(const Eigen::Matrix3d& F, const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
  const Eigen::Vector2d l = F.topLeftCorner<2, 2>() * a + F.topRightCorner<2, 1>();
  const Eigen::Vector2d m = F.topLeftCorner<2, 2>().transpose() * b + F.bottomLeftCorner<1, 2>().transpose();
  return 1 / (l.squaredNorm() + m.squaredNorm());
}

/// The closest matrix of rank 2 in the Frobenius norm: without the part along the right singular vector of least value.
Eigen::Matrix3d EnforceRankTwo(const Eigen::Matrix3d& m) {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(m.transpose() * m);
  const Eigen::Vector3d v = solver.eigenvectors().col(0);
  return m - (m * v) * v.transpose();
}

/// The normalised 8-point algorithm as RANSAC needs it.
class FundamentalProblem {
 public:
  static constexpr size_t kMinMatches = 8;
  static constexpr const char* kName = "fundamental matrix";

  FundamentalProblem(const PixelMatches& matches, double sigma_px)
      : matches_(matches), sigma_px_(sigma_px), first_(matches.first_px), second_(matches.second_px) {}

  size_t size() const { return matches_.first_px.size(); }

  Eigen::Matrix3d FitSample(const Sample& sample) const {
    Eigen::Matrix<double, 9, 8> columns;
    for (size_t k = 0; k < kMinMatches; ++k) columns.col(k) = Row(first_.points[sample[k]], second_.points[sample[k]]);
    return ToPixels(two_view_internal::NullVector(columns));
  }

  Eigen::Matrix3d FitInliers(const TwoViewModel& model) const {
    const Eigen::Matrix3d last = second_.normalized_from_pixel.inverse().transpose() * model.second_from_first *
                                 first_.normalized_from_pixel.inverse();
    Matrix9d sums = Matrix9d::Zero();
    for (size_t i = 0; i < size(); ++i) {
      if (!model.inliers[i]) continue;
      const Vector9d row = Row(first_.points[i], second_.points[i]);
      sums.noalias() += SampsonWeight(last, first_.points[i], second_.points[i]) * row * row.transpose();
    }
    return ToPixels(two_view_internal::SmallestEigenvector(sums));
  }

  double Score(const Eigen::Matrix3d& F, double to_beat, std::vector<bool>* inliers) const {
    return two_view_internal::TruncatedScore(size(), sigma_px_, kChi2, to_beat, inliers, [&](size_t i) {
      return EpipolarErrors(F, matches_.first_px[i], matches_.second_px[i]);
    });
  }

 private:
  /// Squared distances of a match's points from each other's epipolar lines, pixels^2.
  static std::array<double, 2> EpipolarErrors(const Eigen::Matrix3d& F, const Eigen::Vector2d& a,
                                              const Eigen::Vector2d& b) {
    const double l1 = F(0, 0) * a.x() + F(0, 1) * a.y() + F(0, 2);
    const double l2 = F(1, 0) * a.x() + F(1, 1) * a.y() + F(1, 2);
    const double l3 = F(2, 0) * a.x() + F(2, 1) * a.y() + F(2, 2);
    const double m1 = F(0, 0) * b.x() + F(1, 0) * b.y() + F(2, 0);
    const double m2 = F(0, 1) * b.x() + F(1, 1) * b.y() + F(2, 1);
    const double product = l1 * b.x() + l2 * b.y() + l3;
    return {product * product / (l1 * l1 + l2 * l2), product * product / (m1 * m1 + m2 * m2)};
  }

  Eigen::Matrix3d ToPixels(const Vector9d& normalized) const {
    const Eigen::Matrix3d F = EnforceRankTwo(two_view_internal::FromRowMajor(normalized));
    const Eigen::Matrix3d in_pixels = second_.normalized_from_pixel.transpose() * F * first_.normalized_from_pixel;
    return in_pixels / in_pixels.norm();
  }

  const PixelMatches& matches_;
  double sigma_px_;
  NormalizedPoints first_, second_;
};

}  // namespace

Result<TwoViewModel> EstimateFundamental(const PixelMatches& matches, const TwoViewOptions& options) {
  const Status usable =
      two_view_internal::CheckMatches(matches, FundamentalProblem::kMinMatches, FundamentalProblem::kName);
  if (!usable) return usable.error();
  return two_view_internal::RunRansac(FundamentalProblem(matches, options.sigma_px), options);
}

}  // namespace portolan
