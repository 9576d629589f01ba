#include "geometry/two_view_ransac.h"

#include <Eigen/Eigenvalues>
#include <Eigen/QR>

namespace portolan::two_view_internal {

NormalizedPoints::NormalizedPoints(const std::vector<Eigen::Vector2d>& pixels_px) : points(pixels_px) {
  const double n = static_cast<double>(pixels_px.size());
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  for (const Eigen::Vector2d& p : pixels_px) mean += p / n;
  double distance = 0;
  for (const Eigen::Vector2d& p : pixels_px) distance += (p - mean).norm() / n;
  const double scale = distance > 0 ? M_SQRT2 / distance : 1;
  for (Eigen::Vector2d& p : points) p = scale * (p - mean);
  normalized_from_pixel << scale, 0, -scale * mean.x(), 0, scale, -scale * mean.y(), 0, 0, 1;
}

Eigen::Matrix3d FromRowMajor(const Vector9d& v) {
  return Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(v.data());
}

Vector9d NullVector(const Eigen::Matrix<double, 9, 8>& columns) {
  const Eigen::HouseholderQR<Eigen::Matrix<double, 9, 8>> qr(columns);
  return qr.householderQ() * Vector9d(Vector9d::Unit(8));  // the last column of Q
}

Vector9d SmallestEigenvector(const Matrix9d& A) {
  return Eigen::SelfAdjointEigenSolver<Matrix9d>(A).eigenvectors().col(0);
}

Status CheckMatches(const PixelMatches& matches, size_t needed, const std::string& model) {
  PORTOLAN_CHECK(matches.first_px.size() == matches.second_px.size())
      << matches.first_px.size() << " first and " << matches.second_px.size() << " second pixels";
  if (matches.first_px.size() < needed) {
    return Error{model + ": needs at least " + std::to_string(needed) + " matches, got " +
                 std::to_string(matches.first_px.size())};
  }
  for (size_t i = 0; i < matches.first_px.size(); ++i) {
    if (!matches.first_px[i].allFinite() || !matches.second_px[i].allFinite()) {
      return Error{model + ": match " + std::to_string(i) + " has a pixel that is not finite"};
    }
  }
  return Ok{};
}

Sample DrawSample(size_t n, Random* random) {
  Sample sample{};
  const size_t size = std::min(n, kSampleSize);
  for (size_t k = 0; k < size; ++k) {
    do {
      sample[k] = random->Below(n);
    } while (std::find(sample.begin(), sample.begin() + k, sample[k]) != sample.begin() + k);
  }
  return sample;
}

}  // namespace portolan::two_view_internal
