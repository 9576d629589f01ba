#include "geometry/rigid3.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>

#include "geometry/geometry_test_utils.h"

namespace portolan {
namespace {

constexpr double kExact = 1e-10;
constexpr int kTrials = 50;

TEST(Rigid3dTest, IdentityIsNeutral) {
  Random random(1);
  const Rigid3d b_from_a = RandomRigid(&random);
  EXPECT_THAT(Rigid3d() * b_from_a, RigidNear(b_from_a, kExact));
  EXPECT_THAT(b_from_a * Rigid3d(), RigidNear(b_from_a, kExact));
}

TEST(Rigid3dTest, InverseCancels) {
  Random random(2);
  for (int i = 0; i < kTrials; ++i) {
    const Rigid3d b_from_a = RandomRigid(&random);
    EXPECT_THAT(b_from_a * b_from_a.Inverse(), RigidNear(Rigid3d(), 1e-7));
    const Eigen::Vector3d in_a = RandomVector(&random);
    EXPECT_THAT(b_from_a.Inverse() * (b_from_a * in_a), VectorNear(in_a, kExact));
  }
}

TEST(Rigid3dTest, CompositionActsLikeOneAfterTheOther) {
  Random random(3);
  for (int i = 0; i < kTrials; ++i) {
    const Rigid3d c_from_b = RandomRigid(&random), b_from_a = RandomRigid(&random);
    const Eigen::Vector3d in_a = RandomVector(&random);
    EXPECT_THAT((c_from_b * b_from_a) * in_a, VectorNear(Eigen::Vector3d(c_from_b * (b_from_a * in_a)), kExact));
  }
}

TEST(Rigid3dTest, CompositionIsAssociative) {
  Random random(4);
  const Rigid3d d_from_c = RandomRigid(&random), c_from_b = RandomRigid(&random), b_from_a = RandomRigid(&random);
  const Eigen::Vector3d in_a = RandomVector(&random);
  EXPECT_THAT(((d_from_c * c_from_b) * b_from_a) * in_a,
              VectorNear(Eigen::Vector3d((d_from_c * (c_from_b * b_from_a)) * in_a), kExact));
}

TEST(Rigid3dTest, MatrixActsLikeTheMotion) {
  Random random(5);
  const Rigid3d b_from_a = RandomRigid(&random);
  const Eigen::Vector3d in_a = RandomVector(&random);
  EXPECT_THAT(Eigen::Vector3d(b_from_a.Matrix() * in_a.homogeneous()),
              VectorNear(Eigen::Vector3d(b_from_a * in_a), kExact));
}

TEST(Rigid3dTest, TargetOriginMapsToZero) {
  Random random(6);
  const Rigid3d camera_from_map = RandomRigid(&random);
  EXPECT_THAT(camera_from_map * camera_from_map.TargetOriginInSource(), VectorNear(Eigen::Vector3d(0, 0, 0), kExact));
}

TEST(LieTest, SkewIsTheCrossProduct) {
  Random random(7);
  const Eigen::Vector3d a = RandomVector(&random), b = RandomVector(&random);
  EXPECT_THAT(Eigen::Vector3d(Skew(a) * b), VectorNear(Eigen::Vector3d(a.cross(b)), kExact));
}

TEST(LieTest, LogInvertsExpFromTinyAnglesToNearlyPi) {
  const Eigen::Vector3d axis = Eigen::Vector3d(1, -2, 0.5).normalized();
  for (const double angle : {0.0, 1e-12, 1e-8, 1e-6, 1e-5, 1e-3, 0.1, 1.0, 3.0, 3.14159}) {
    Vector6d twist;
    twist << 0.3, -2, 1, angle * axis;
    EXPECT_THAT(LogSE3(ExpSE3(twist)), VectorNear(twist, 1e-8)) << "angle " << angle;
  }
}

TEST(LieTest, ExpOfLogIsTheMotionAlsoForTheOtherSignOfTheQuaternion) {
  Random random(8);
  for (int i = 0; i < kTrials; ++i) {
    Rigid3d motion = RandomRigid(&random);
    EXPECT_THAT(ExpSE3(LogSE3(motion)), RigidNear(motion, 1e-7));
    motion.rotation.coeffs() *= -1;
    EXPECT_THAT(ExpSE3(LogSE3(motion)), RigidNear(motion, 1e-7));
  }
}

TEST(LieTest, ExpAddsUpAlongOneTwist) {
  Random random(9);
  Vector6d twist;
  twist << RandomVector(&random), RandomVector(&random, 0.5);
  EXPECT_THAT(ExpSE3(0.3 * twist) * ExpSE3(0.7 * twist), RigidNear(ExpSE3(twist), 1e-7));
}

TEST(LieTest, ExpOfPureTranslationIsTheTranslation) {
  Vector6d twist;
  twist << 1, 2, 3, 0, 0, 0;
  EXPECT_THAT(ExpSE3(twist), RigidNear(Rigid3d(Eigen::Quaterniond::Identity(), {1, 2, 3}), kExact));
}

TEST(LieTest, ExpTurnsByTheRightHand) {
  EXPECT_THAT(ExpSO3({0, 0, M_PI / 2}) * Eigen::Vector3d(1, 0, 0), VectorNear(Eigen::Vector3d(0, 1, 0), kExact));
}

TEST(LieTest, LeftJacobianIsTheDerivativeOfExp) {
  constexpr double kStep = 1e-6;
  Random random(10);
  for (const double angle : {0.0, 1e-7, 0.1, 1.0, 2.5}) {
    const Eigen::Vector3d r = angle * RandomVector(&random).normalized();
    for (int k = 0; k < 3; ++k) {
      const Eigen::Vector3d d = kStep * Eigen::Vector3d::Unit(k);
      const Eigen::Vector3d numeric = LogSO3(ExpSO3(r + d) * ExpSO3(r - d).conjugate()) / (2 * kStep);
      EXPECT_THAT(Eigen::Vector3d(LeftJacobianSO3(r).col(k)), VectorNear(numeric, 1e-7)) << "angle " << angle;
    }
  }
}

}  // namespace
}  // namespace portolan
