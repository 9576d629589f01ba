#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "geometry/rigid3.h"

namespace portolan {

using Vector7d = Eigen::Matrix<double, 7, 1>;

/// A similarity of 3D space (paper Eq. 12): x_in_b = scale * rotation * x_in_a + translation, named b_from_a.
struct Sim3d {
  double scale = 1.0;  ///< positive
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();

  Sim3d() = default;
  Sim3d(double s, const Eigen::Quaterniond& r, const Eigen::Vector3d& t) : scale(s), rotation(r), translation(t) {}
  explicit Sim3d(const Rigid3d& rigid) : rotation(rigid.rotation), translation(rigid.translation) {}

  Eigen::Vector3d operator*(const Eigen::Vector3d& point) const { return scale * (rotation * point) + translation; }
  Sim3d operator*(const Sim3d& other) const {
    return Sim3d(scale * other.scale, (rotation * other.rotation).normalized(),
                 scale * (rotation * other.translation) + translation);
  }
  Sim3d Inverse() const {
    const Eigen::Quaterniond inverse = rotation.conjugate();
    return Sim3d(1.0 / scale, inverse, -(inverse * translation) / scale);
  }
};

/// A camera's similarity as a pose in the map's own units: [R t/s] (paper Eq. 13). The camera stays where it is.
Rigid3d MakeRigid(const Sim3d& camera_from_map);

/// camera_from_b of a camera whose pose was camera_from_a, with b_from_a a similarity between maps: the camera stays
/// where it is in the scene and lengths change to b's units. Rigid: [R t/s] (paper Eq. 13).
Rigid3d TransformPose(const Rigid3d& camera_from_a, const Sim3d& b_from_a);

/// Exponential and logarithm of Sim(3). Twist order: 3 of translation, 3 of rotation, the scale's logarithm; the angle
/// is below pi for the logarithm.
/// exp(rho, omega, sigma) = [e^sigma Exp(omega), W rho] with W the integral of exp(t A) over t from 0 to 1,
/// A = sigma I + [omega]x.
/// Source: Ethan Eade, Lie groups for 2D and 3D transformations; W as the power series sum A^k / (k + 1)!, which needs
/// no cases for small angles and scales.
Sim3d ExpSim3(const Vector7d& twist);
Vector7d LogSim3(const Sim3d& similarity);

}  // namespace portolan
