#include "geometry/triangulation.h"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <array>
#include <cmath>
#include <limits>

#include "geometry/polynomial_roots.h"

namespace portolan {
namespace {

/// Below this inverse depth (in baselines) a point counts as infinitely far: no pixel noise lets two views tell it from
/// infinity.
constexpr double kMinInverseDepth = 1e-6;

/// Null vector of a 3x3 matrix of rank 2: the largest cross product of two of its columns, orthogonal to all of them.
Eigen::Vector3d LeftNullVector(const Eigen::Matrix3d& m) {
  const std::array<Eigen::Vector3d, 3> candidates = {m.col(0).cross(m.col(1)), m.col(1).cross(m.col(2)),
                                                     m.col(2).cross(m.col(0))};
  const Eigen::Vector3d* best = &candidates[0];
  for (const Eigen::Vector3d& candidate : candidates) {
    if (candidate.squaredNorm() > best->squaredNorm()) best = &candidate;
  }
  return *best;
}

/// The pencil of corresponding epipolar lines in coordinates where both measured points are origins and both epipoles
/// lie on the x axis, at (1, 0, f) and (1, 0, g): Hartley and Zisserman, Eq. 12.3 to 12.7 (their f' is g here). The
/// line with parameter t passes through (0, t) in the first image.
struct EpipolarPencil {
  double a, b, c, d, f, g;

  /// Eq. 12.5: squared distances of the two origins from the lines of parameter t, the d^2 + d'^2 of paper Eq. (10).
  double Cost(double t) const {
    const double u = a * t + b, v = c * t + d;
    return t * t / (1 + f * f * t * t) + v * v / (u * u + g * g * v * v);
  }
  double CostAtInfinity() const { return 1 / (f * f) + c * c / (a * a + g * g * c * c); }

  /// Eq. 12.7: its roots are the stationary points of the cost. Coefficients from t^0 to t^6.
  std::array<double, 7> StationaryPolynomial() const {
    // (at + b)^2 + g^2 (ct + d)^2 = p0 + p1 t + p2 t^2, and (at + b)(ct + d) = q0 + q1 t + q2 t^2
    const double p0 = b * b + g * g * d * d, p1 = 2 * (a * b + g * g * c * d), p2 = a * a + g * g * c * c;
    const double q0 = b * d, q1 = a * d + b * c, q2 = a * c;
    const double determinant = a * d - b * c;
    const double h1 = 2 * f * f, h2 = f * f * f * f;  // (1 + f^2 t^2)^2 = 1 + h1 t^2 + h2 t^4
    return {-determinant * q0,
            p0 * p0 - determinant * q1,
            2 * p0 * p1 - determinant * (q2 + h1 * q0),
            p1 * p1 + 2 * p0 * p2 - determinant * h1 * q1,
            2 * p1 * p2 - determinant * (h1 * q2 + h2 * q0),
            p2 * p2 - determinant * h2 * q1,
            -determinant * h2 * q2};
  }
};

/// The foot of the perpendicular from the origin onto a line.
Eigen::Vector2d FootOfPerpendicular(double l1, double l2, double l3) {
  return Eigen::Vector2d(-l1 * l3, -l2 * l3) / (l1 * l1 + l2 * l2);
}

/// The feet on the best pair of lines, in the pencil's coordinates.
std::pair<Eigen::Vector2d, Eigen::Vector2d> ClosestFeet(const EpipolarPencil& p) {
  double best_cost = p.CostAtInfinity();
  double best_t = std::numeric_limits<double>::infinity();
  for (const double t : RealRoots(p.StationaryPolynomial())) {
    const double cost = p.Cost(t);
    if (cost < best_cost || std::isnan(best_cost)) {
      best_cost = cost;
      best_t = t;
    }
  }
  if (std::isinf(best_t)) return {FootOfPerpendicular(p.f, 0, -1), FootOfPerpendicular(-p.g * p.c, p.a, p.c)};
  const double v = p.c * best_t + p.d;
  return {FootOfPerpendicular(best_t * p.f, 1, -best_t), FootOfPerpendicular(-p.g * v, p.a * best_t + p.b, v)};
}

/// Rotation about the origin that brings the epipole onto the positive x axis.
Eigen::Matrix3d RotationToAxis(const Eigen::Vector3d& epipole) {
  Eigen::Matrix3d rotation;
  rotation << epipole.x(), epipole.y(), 0, -epipole.y(), epipole.x(), 0, 0, 0, 1;
  return rotation;
}

Eigen::Matrix3d Translation(const Eigen::Vector2d& offset) {
  Eigen::Matrix3d translation = Eigen::Matrix3d::Identity();
  translation.topRightCorner<2, 1>() = offset;
  return translation;
}

}  // namespace

std::pair<Eigen::Vector2d, Eigen::Vector2d> CorrectMatch(const Eigen::Matrix3d& second_from_first,
                                                         const Eigen::Vector2d& first_px,
                                                         const Eigen::Vector2d& second_px) {
  // Steps (i) to (v) of Hartley and Zisserman, Alg. 12.1: origins at the points, epipoles on the x axes.
  Eigen::Matrix3d F = Translation(second_px).transpose() * second_from_first * Translation(first_px);
  F /= F.norm();
  Eigen::Vector3d first_epipole = LeftNullVector(F.transpose());
  Eigen::Vector3d second_epipole = LeftNullVector(F);
  first_epipole /= first_epipole.head<2>().norm();
  second_epipole /= second_epipole.head<2>().norm();
  const Eigen::Matrix3d first_rotation = RotationToAxis(first_epipole);
  const Eigen::Matrix3d second_rotation = RotationToAxis(second_epipole);
  F = second_rotation * F * first_rotation.transpose();
  // Steps (vi) to (xi): the best line of the pencil, and back.
  const EpipolarPencil pencil{F(1, 1), F(1, 2), F(2, 1), F(2, 2), first_epipole.z(), second_epipole.z()};
  const auto [first_foot, second_foot] = ClosestFeet(pencil);
  const Eigen::Vector2d first = first_px + first_rotation.topLeftCorner<2, 2>().transpose() * first_foot;
  const Eigen::Vector2d second = second_px + second_rotation.topLeftCorner<2, 2>().transpose() * second_foot;
  if (!first.allFinite() || !second.allFinite()) return {first_px, second_px};
  return {first, second};
}

Eigen::Matrix3d FundamentalFromMotion(const Rigid3d& second_from_first, const PinholeCamera& first_camera,
                                      const PinholeCamera& second_camera) {
  const Eigen::Matrix3d essential = Skew(second_from_first.translation) * second_from_first.rotation.toRotationMatrix();
  return second_camera.K().inverse().transpose() * essential * first_camera.K().inverse();
}

std::optional<Eigen::Vector3d> TriangulateDlt(const Rigid3d& first_from_map, const Rigid3d& second_from_map,
                                              const Eigen::Vector2d& first_xy, const Eigen::Vector2d& second_xy) {
  // In the first camera's frame with the baseline as unit of length the equations are equally well conditioned anywhere
  // in a map.
  const Rigid3d map_from_first = first_from_map.Inverse();
  const Rigid3d second_from_first = second_from_map * map_from_first;
  const double baseline = second_from_first.translation.norm();
  if (!(baseline > 0)) return std::nullopt;
  Eigen::Matrix<double, 3, 4> second;
  second << second_from_first.rotation.toRotationMatrix(), second_from_first.translation / baseline;
  Eigen::Matrix4d A;  // paper Eq. (11): A X = 0
  A.row(0) << -1, 0, first_xy.x(), 0;
  A.row(1) << 0, -1, first_xy.y(), 0;
  A.row(2) = second_xy.x() * second.row(2) - second.row(0);
  A.row(3) = second_xy.y() * second.row(2) - second.row(1);
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix4d> solver(A.transpose() * A);
  const Eigen::Vector4d X = solver.eigenvectors().col(0);
  if (!(std::abs(X.w()) > kMinInverseDepth * X.head<3>().norm())) return std::nullopt;
  return map_from_first * Eigen::Vector3d(X.head<3>() * (baseline / X.w()));
}

double ParallaxCosine(const Eigen::Vector3d& first_centre, const Eigen::Vector3d& second_centre,
                      const Eigen::Vector3d& point) {
  const Eigen::Vector3d first_ray = point - first_centre;
  const Eigen::Vector3d second_ray = point - second_centre;
  return first_ray.dot(second_ray) / std::sqrt(first_ray.squaredNorm() * second_ray.squaredNorm());
}

}  // namespace portolan
