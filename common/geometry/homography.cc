#include <Eigen/LU>

#include "geometry/two_view.h"
#include "geometry/two_view_ransac.h"

namespace portolan {
namespace {

using two_view_internal::Matrix9d;
using two_view_internal::NormalizedPoints;
using two_view_internal::Sample;
using two_view_internal::Vector9d;

constexpr double kChi2 = 5.99;  // 95 % of a chi-square with 2 degrees of freedom: distance of a point from a point

/// A match's two equations for the row-major H: x2 x H x1 = 0 (Hartley and Zisserman, Eq. 4.3).
std::array<Vector9d, 2> Rows(const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
  std::array<Vector9d, 2> rows;
  rows[0] << 0, 0, 0, -a.x(), -a.y(), -1, b.y() * a.x(), b.y() * a.y(), b.y();
  rows[1] << a.x(), a.y(), 1, 0, 0, 0, -b.x() * a.x(), -b.x() * a.y(), -b.x();
  return rows;
}

/// The normalised DLT as RANSAC needs it.
class HomographyProblem {
 public:
  static constexpr size_t kMinMatches = 4;
  static constexpr const char* kName = "homography";

  HomographyProblem(const PixelMatches& matches, double sigma_px)
      : matches_(matches), sigma_px_(sigma_px), first_(matches.first_px), second_(matches.second_px) {}

  size_t size() const { return matches_.first_px.size(); }

  /// Of a sample of eight the first four: a smaller sample is less often spoilt by an outlier.
  Eigen::Matrix3d FitSample(const Sample& sample) const {
    Eigen::Matrix<double, 9, 8> columns;
    for (size_t k = 0; k < kMinMatches; ++k) {
      const auto rows = Rows(first_.points[sample[k]], second_.points[sample[k]]);
      columns.col(2 * k) = rows[0];
      columns.col(2 * k + 1) = rows[1];
    }
    return ToPixels(two_view_internal::NullVector(columns));
  }

  /// Each match is weighted by 1 / w^2 of the last model, x2 ~ (u, v, w): the algebraic error becomes the transfer
  /// error.
  Eigen::Matrix3d FitInliers(const TwoViewModel& model) const {
    const Eigen::Matrix3d last =
        second_.normalized_from_pixel * model.second_from_first * first_.normalized_from_pixel.inverse();
    Matrix9d sums = Matrix9d::Zero();
    for (size_t i = 0; i < size(); ++i) {
      if (!model.inliers[i]) continue;
      const double w = last.row(2).dot(first_.points[i].homogeneous());
      for (const Vector9d& row : Rows(first_.points[i], second_.points[i])) {
        sums.noalias() += 1 / (w * w) * row * row.transpose();
      }
    }
    return ToPixels(two_view_internal::SmallestEigenvector(sums));
  }

  double Score(const Eigen::Matrix3d& H, double to_beat, std::vector<bool>* inliers) const {
    const Eigen::Matrix3d inverse = H.inverse();
    return two_view_internal::TruncatedScore(size(), sigma_px_, kChi2, to_beat, inliers, [&](size_t i) {
      const Eigen::Vector2d &a = matches_.first_px[i], &b = matches_.second_px[i];
      return std::array<double, 2>{TransferError(H, a, b), TransferError(inverse, b, a)};
    });
  }

 private:
  /// Squared distance of b from H a, pixels^2.
  static double TransferError(const Eigen::Matrix3d& H, const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
    const double w = 1 / (H(2, 0) * a.x() + H(2, 1) * a.y() + H(2, 2));
    const double dx = (H(0, 0) * a.x() + H(0, 1) * a.y() + H(0, 2)) * w - b.x();
    const double dy = (H(1, 0) * a.x() + H(1, 1) * a.y() + H(1, 2)) * w - b.y();
    return dx * dx + dy * dy;
  }

  Eigen::Matrix3d ToPixels(const Vector9d& normalized) const {
    const Eigen::Matrix3d H = two_view_internal::FromRowMajor(normalized);
    const Eigen::Matrix3d in_pixels = second_.normalized_from_pixel.inverse() * H * first_.normalized_from_pixel;
    return in_pixels / in_pixels.norm();
  }

  const PixelMatches& matches_;
  double sigma_px_;
  NormalizedPoints first_, second_;
};

}  // namespace

Result<TwoViewModel> EstimateHomography(const PixelMatches& matches, const TwoViewOptions& options) {
  const Status usable =
      two_view_internal::CheckMatches(matches, HomographyProblem::kMinMatches, HomographyProblem::kName);
  if (!usable) return usable.error();
  return two_view_internal::RunRansac(HomographyProblem(matches, options.sigma_px), options);
}

}  // namespace portolan
