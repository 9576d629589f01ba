#pragma once

#include <gmock/gmock.h>

#include <Eigen/Core>

#include "base/random.h"
#include "geometry/camera_model.h"
#include "geometry/rigid3.h"
#include "geometry/sim3.h"

/// What tests of geometry and optimisation share: random motions and points, a camera, matchers.
namespace portolan {

inline Eigen::Vector3d RandomVector(Random* random, double sigma = 1.0) {
  const double x = random->Gaussian(), y = random->Gaussian(), z = random->Gaussian();
  return sigma * Eigen::Vector3d(x, y, z);
}

inline Eigen::Vector2d RandomNoise(Random* random, double sigma_px) {
  const double x = random->Gaussian(), y = random->Gaussian();
  return sigma_px * Eigen::Vector2d(x, y);
}

inline Rigid3d RandomRigid(Random* random, double rotation_sigma = 1.0, double translation_sigma = 1.0) {
  const Eigen::Vector3d rotation = RandomVector(random, rotation_sigma);
  return Rigid3d(ExpSO3(rotation), RandomVector(random, translation_sigma));
}

inline Sim3d RandomSim3(Random* random) {
  const Rigid3d rigid = RandomRigid(random);
  return Sim3d(std::exp(random->Uniform(-1, 1)), rigid.rotation, rigid.translation);
}

/// A camera like that of the kitchen sequence.
inline PinholeCamera TestCamera() {
  return PinholeCamera{500, 510, 320, 240, 640, 480};
}

inline Eigen::Vector2d RandomPixel(Random* random, const PinholeCamera& camera) {
  const double x = random->Uniform(0, camera.width - 1), y = random->Uniform(0, camera.height - 1);
  return {x, y};
}

/// A point that the camera sees, at a depth drawn uniformly.
inline Eigen::Vector3d RandomPointInView(Random* random, const PinholeCamera& camera, double min_depth,
                                         double max_depth) {
  const Eigen::Vector2d pixel = RandomPixel(random, camera);
  return camera.Unproject(pixel) * random->Uniform(min_depth, max_depth);
}

MATCHER_P2(VectorNear, expected, tolerance, "is near " + testing::PrintToString(expected.transpose())) {
  *result_listener << "which is " << (arg - expected).norm() << " away";
  return (arg - expected).norm() <= tolerance;
}

/// Both parts within the tolerance: radians, and units of length.
MATCHER_P2(RigidNear, expected, tolerance, "is near the expected motion") {
  const double angle = arg.rotation.angularDistance(expected.rotation);
  const double distance = (arg.translation - expected.translation).norm();
  *result_listener << "which is " << angle << " rad and " << distance << " away";
  return angle <= tolerance && distance <= tolerance;
}

}  // namespace portolan
