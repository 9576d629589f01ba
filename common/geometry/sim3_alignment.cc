#include "geometry/sim3_alignment.h"

#include <Eigen/LU>
#include <Eigen/SVD>
#include <string>

#include "base/check.h"

namespace portolan {
namespace {

constexpr size_t kMinPoints = 3;
/// Of the spread's second to its first singular value (lengths squared): below it the points lie on a line within a
/// millionth of their extent, and the rotation about it is anyone's guess.
constexpr double kCollinear = 1e-12;

Eigen::Vector3d Mean(const std::vector<Eigen::Vector3d>& points) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& point : points) sum += point;
  return sum / static_cast<double>(points.size());
}

}  // namespace

Result<Sim3d> AlignPoints(const std::vector<Eigen::Vector3d>& points_in_a,
                          const std::vector<Eigen::Vector3d>& points_in_b, bool fix_scale) {
  PORTOLAN_CHECK(points_in_a.size() == points_in_b.size())
      << points_in_a.size() << " points in a, " << points_in_b.size() << " in b";
  const size_t n = points_in_a.size();
  if (n < kMinPoints) return Error{"alignment: needs at least 3 points, got " + std::to_string(n)};
  const Eigen::Vector3d mean_a = Mean(points_in_a), mean_b = Mean(points_in_b);
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero(), spread_a = covariance, spread_b = covariance;
  for (size_t i = 0; i < n; ++i) {
    const Eigen::Vector3d a = points_in_a[i] - mean_a, b = points_in_b[i] - mean_b;
    covariance += b * a.transpose();  // Umeyama 1991, Eq. 38
    spread_a += a * a.transpose();
    spread_b += b * b.transpose();
  }
  if (!covariance.allFinite() || !spread_a.allFinite() || !spread_b.allFinite())
    return Error{"alignment: a point is not finite"};
  for (const Eigen::Matrix3d& spread : {spread_a, spread_b}) {
    const Eigen::Vector3d s = Eigen::JacobiSVD<Eigen::Matrix3d>(spread).singularValues();
    if (!(s[1] > kCollinear * s[0])) return Error{"alignment: all " + std::to_string(n) + " points lie on a line"};
  }
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(covariance, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Vector3d signs = Eigen::Vector3d::Ones();  // Eq. 39: no reflections
  if (svd.matrixU().determinant() * svd.matrixV().determinant() < 0) signs.z() = -1;
  const Eigen::Matrix3d rotation = svd.matrixU() * signs.asDiagonal() * svd.matrixV().transpose();  // Eq. 40
  const double scale = fix_scale ? 1.0 : svd.singularValues().dot(signs) / spread_a.trace();        // Eq. 42
  if (!(scale > 0)) return Error{"alignment: the points of a and b are mirror images"};
  const Eigen::Quaterniond unit = Eigen::Quaterniond(rotation).normalized();
  return Sim3d(scale, unit, mean_b - scale * (unit * mean_a));  // Eq. 41
}

}  // namespace portolan
