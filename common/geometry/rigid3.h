#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace portolan {

using Vector6d = Eigen::Matrix<double, 6, 1>;
using Matrix6d = Eigen::Matrix<double, 6, 6>;

/// A rigid motion of 3D space. Named target_from_source: x_in_b = b_from_a * x_in_a, and c_from_a = c_from_b *
/// b_from_a.
struct Rigid3d {
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();  ///< unit quaternion
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();

  Rigid3d() = default;
  Rigid3d(const Eigen::Quaterniond& r, const Eigen::Vector3d& t) : rotation(r), translation(t) {}

  Eigen::Vector3d operator*(const Eigen::Vector3d& point) const { return rotation * point + translation; }
  Rigid3d operator*(const Rigid3d& other) const {
    return Rigid3d((rotation * other.rotation).normalized(), rotation * other.translation + translation);
  }
  Rigid3d Inverse() const {
    const Eigen::Quaterniond inverse = rotation.conjugate();
    return Rigid3d(inverse, -(inverse * translation));
  }
  /// Origin of the target frame in the source frame: the camera's centre in the map, for camera_from_map.
  Eigen::Vector3d TargetOriginInSource() const { return -(rotation.conjugate() * translation); }
  /// 3x4 [R t].
  Eigen::Matrix<double, 3, 4> Matrix() const;
};

/// The 3x3 matrix of the cross product: Skew(a) * b = a x b.
Eigen::Matrix3d Skew(const Eigen::Vector3d& v);

/// Exponential and logarithm of SO(3); the rotation vector is axis * angle, angle below pi for the logarithm.
Eigen::Quaterniond ExpSO3(const Eigen::Vector3d& rotation_vector);
Eigen::Vector3d LogSO3(const Eigen::Quaterniond& rotation);

/// The left Jacobian of SO(3): Exp(r + d) = Exp(J d) Exp(r) to first order; it also maps the translation of a twist.
Eigen::Matrix3d LeftJacobianSO3(const Eigen::Vector3d& rotation_vector);

/// Exponential and logarithm of SE(3) (paper Eq. 1, 2). Twist order: 3 of translation, then 3 of rotation.
/// Source: Ethan Eade, Lie groups for 2D and 3D transformations (the paper's [18] has the same closed forms).
Rigid3d ExpSE3(const Vector6d& twist);
Vector6d LogSE3(const Rigid3d& motion);

}  // namespace portolan
