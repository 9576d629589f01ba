#include "geometry/sim3.h"

#include <Eigen/LU>
#include <cmath>

namespace portolan {
namespace {

/// W of the header. The series converges everywhere; with |A| below 5 after some 35 terms.
Eigen::Matrix3d TranslationOfTwist(const Eigen::Vector3d& omega, double sigma) {
  constexpr int kMostTerms = 200;
  constexpr double kNegligible = 1e-18;
  const Eigen::Matrix3d a = sigma * Eigen::Matrix3d::Identity() + Skew(omega);
  Eigen::Matrix3d term = Eigen::Matrix3d::Identity(), sum = term;
  for (int k = 1; k < kMostTerms && term.cwiseAbs().maxCoeff() > kNegligible; ++k) {
    term = term * a / (k + 1);
    sum += term;
  }
  return sum;
}

}  // namespace

Rigid3d MakeRigid(const Sim3d& camera_from_map) {
  return Rigid3d(camera_from_map.rotation.normalized(), camera_from_map.translation / camera_from_map.scale);
}

Rigid3d TransformPose(const Rigid3d& camera_from_a, const Sim3d& b_from_a) {
  return MakeRigid(Sim3d(camera_from_a) * b_from_a.Inverse());
}

Sim3d ExpSim3(const Vector7d& twist) {
  const Eigen::Vector3d rho = twist.head<3>(), omega = twist.segment<3>(3);
  const double sigma = twist[6];
  return Sim3d(std::exp(sigma), ExpSO3(omega), TranslationOfTwist(omega, sigma) * rho);
}

Vector7d LogSim3(const Sim3d& similarity) {
  const Eigen::Vector3d omega = LogSO3(similarity.rotation);
  const double sigma = std::log(similarity.scale);
  Vector7d twist;
  twist << TranslationOfTwist(omega, sigma).inverse() * similarity.translation, omega, sigma;
  return twist;
}

}  // namespace portolan
