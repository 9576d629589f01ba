#include "geometry/rigid3.h"

#include <cmath>

namespace portolan {
namespace {

constexpr double kSmallAngle = 1e-6;  // below it the Taylor series is exact to double precision

}  // namespace

Eigen::Matrix<double, 3, 4> Rigid3d::Matrix() const {
  Eigen::Matrix<double, 3, 4> matrix;
  matrix << rotation.toRotationMatrix(), translation;
  return matrix;
}

Eigen::Matrix3d Skew(const Eigen::Vector3d& v) {
  Eigen::Matrix3d m;
  m << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
  return m;
}

Eigen::Quaterniond ExpSO3(const Eigen::Vector3d& rotation_vector) {
  const double angle = rotation_vector.norm();
  const double half = 0.5 * angle;
  const double factor = angle < kSmallAngle ? 0.5 - angle * angle / 48.0 : std::sin(half) / angle;
  const Eigen::Vector3d v = factor * rotation_vector;
  return Eigen::Quaterniond(std::cos(half), v.x(), v.y(), v.z()).normalized();
}

Eigen::Vector3d LogSO3(const Eigen::Quaterniond& rotation) {
  const double sign = rotation.w() < 0 ? -1.0 : 1.0;
  const Eigen::Vector3d v = sign * rotation.vec();
  const double sine = v.norm();
  const double angle = 2.0 * std::atan2(sine, sign * rotation.w());
  if (sine < kSmallAngle) return 2.0 * v / (sign * rotation.w());
  return angle / sine * v;
}

Eigen::Matrix3d LeftJacobianSO3(const Eigen::Vector3d& rotation_vector) {
  const double angle2 = rotation_vector.squaredNorm();
  const double angle = std::sqrt(angle2);
  const Eigen::Matrix3d w = Skew(rotation_vector);
  if (angle < kSmallAngle) return Eigen::Matrix3d::Identity() + 0.5 * w + w * w / 6.0;
  return Eigen::Matrix3d::Identity() + (1.0 - std::cos(angle)) / angle2 * w +
         (angle - std::sin(angle)) / (angle2 * angle) * w * w;
}

Rigid3d ExpSE3(const Vector6d& twist) {
  const Eigen::Vector3d phi = twist.tail<3>();
  return Rigid3d(ExpSO3(phi), LeftJacobianSO3(phi) * twist.head<3>());
}

Vector6d LogSE3(const Rigid3d& motion) {
  Vector6d twist;
  const Eigen::Vector3d phi = LogSO3(motion.rotation);
  twist.tail<3>() = phi;
  twist.head<3>() = LeftJacobianSO3(phi).inverse() * motion.translation;
  return twist;
}

}  // namespace portolan
