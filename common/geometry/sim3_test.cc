#include "geometry/sim3.h"

#include <gtest/gtest.h>

#include "geometry/geometry_test_utils.h"

namespace portolan {
namespace {

constexpr double kExact = 1e-10;
constexpr int kTrials = 50;

TEST(Sim3dTest, InverseCancels) {
  Random random(1);
  for (int i = 0; i < kTrials; ++i) {
    const Sim3d b_from_a = RandomSim3(&random);
    const Eigen::Vector3d in_a = RandomVector(&random);
    EXPECT_THAT(b_from_a.Inverse() * (b_from_a * in_a), VectorNear(in_a, kExact));
    EXPECT_NEAR((b_from_a * b_from_a.Inverse()).scale, 1, kExact);
  }
}

TEST(Sim3dTest, CompositionActsLikeOneAfterTheOther) {
  Random random(2);
  for (int i = 0; i < kTrials; ++i) {
    const Sim3d c_from_b = RandomSim3(&random), b_from_a = RandomSim3(&random);
    const Eigen::Vector3d in_a = RandomVector(&random);
    EXPECT_THAT((c_from_b * b_from_a) * in_a, VectorNear(Eigen::Vector3d(c_from_b * (b_from_a * in_a)), kExact));
    EXPECT_NEAR((c_from_b * b_from_a).scale, c_from_b.scale * b_from_a.scale, kExact);
  }
}

TEST(Sim3dTest, OfARigidMotionActsLikeIt) {
  Random random(3);
  const Rigid3d b_from_a = RandomRigid(&random);
  const Eigen::Vector3d in_a = RandomVector(&random);
  EXPECT_THAT(Sim3d(b_from_a) * in_a, VectorNear(Eigen::Vector3d(b_from_a * in_a), kExact));
}

TEST(Sim3dTest, LengthsGrowByTheScale) {
  Random random(4);
  const Sim3d b_from_a = RandomSim3(&random);
  const Eigen::Vector3d p = RandomVector(&random), q = RandomVector(&random);
  EXPECT_NEAR((b_from_a * p - b_from_a * q).norm(), b_from_a.scale * (p - q).norm(), kExact);
}

TEST(MakeRigidTest, KeepsRaysAndCentre) {
  Random random(8);
  const Sim3d camera_from_map = RandomSim3(&random);
  const Rigid3d rigid = MakeRigid(camera_from_map);
  const Eigen::Vector3d in_map = RandomVector(&random);
  EXPECT_THAT(camera_from_map.scale * (rigid * in_map), VectorNear(Eigen::Vector3d(camera_from_map * in_map), kExact));
  EXPECT_THAT(rigid.TargetOriginInSource(), VectorNear(camera_from_map.Inverse().translation, kExact));
}

TEST(TransformPoseTest, CameraSeesTheTransformedPointsAtTheSamePixels) {
  Random random(5);
  for (int i = 0; i < kTrials; ++i) {
    const Rigid3d camera_from_a = RandomRigid(&random);
    const Sim3d b_from_a = RandomSim3(&random);
    const Rigid3d camera_from_b = TransformPose(camera_from_a, b_from_a);
    const Eigen::Vector3d in_a = RandomVector(&random);
    const Eigen::Vector3d expected = b_from_a.scale * (camera_from_a * in_a);  // the same ray; lengths in units of b
    EXPECT_THAT(camera_from_b * (b_from_a * in_a), VectorNear(expected, kExact));
  }
}

TEST(TransformPoseTest, CentreMovesLikeAPoint) {
  Random random(6);
  const Rigid3d camera_from_a = RandomRigid(&random);
  const Sim3d b_from_a = RandomSim3(&random);
  const Eigen::Vector3d expected = b_from_a * camera_from_a.TargetOriginInSource();
  EXPECT_THAT(TransformPose(camera_from_a, b_from_a).TargetOriginInSource(), VectorNear(expected, kExact));
}

TEST(TransformPoseTest, ComposesOverMaps) {
  Random random(7);
  const Rigid3d camera_from_a = RandomRigid(&random);
  const Sim3d b_from_a = RandomSim3(&random), c_from_b = RandomSim3(&random);
  EXPECT_THAT(TransformPose(TransformPose(camera_from_a, b_from_a), c_from_b),
              RigidNear(TransformPose(camera_from_a, c_from_b * b_from_a), 1e-7));
}

Vector7d RandomTwist(Random* random) {
  Vector7d twist;
  twist << RandomVector(random, 2), RandomVector(random).normalized() * random->Uniform(0, 3.1), random->Uniform(-2, 2);
  return twist;
}

TEST(ExpSim3Test, LogarithmUndoesIt) {
  Random random(8);
  for (int i = 0; i < kTrials; ++i) {
    const Vector7d twist = RandomTwist(&random);
    EXPECT_THAT(LogSim3(ExpSim3(twist)), VectorNear(twist, 1e-7));
    const Sim3d b_from_a = RandomSim3(&random);
    const Eigen::Vector3d in_a = RandomVector(&random);
    EXPECT_THAT(ExpSim3(LogSim3(b_from_a)) * in_a, VectorNear(Eigen::Vector3d(b_from_a * in_a), 1e-7));
  }
}

TEST(ExpSim3Test, HoldsForTinyTwistsAndForEachPartAlone) {
  Random random(9);
  for (const double size : {0.0, 1e-12, 1e-8, 1e-4, 1e-2}) {
    const Vector7d twist = size * RandomTwist(&random);
    EXPECT_THAT(LogSim3(ExpSim3(twist)), VectorNear(twist, 1e-12));
  }
  for (int i = 0; i < 7; ++i) {
    const Vector7d twist = 0.7 * Vector7d::Unit(i);
    EXPECT_THAT(LogSim3(ExpSim3(twist)), VectorNear(twist, kExact));
  }
}

TEST(ExpSim3Test, IsAOneParameterGroup) {
  Random random(10);
  for (int i = 0; i < kTrials; ++i) {
    const Vector7d twist = 0.3 * RandomTwist(&random);
    const Eigen::Vector3d in_a = RandomVector(&random);
    const Eigen::Vector3d twice = ExpSim3(twist) * (ExpSim3(twist) * in_a);
    EXPECT_THAT(ExpSim3(2 * twist) * in_a, VectorNear(twice, 1e-9));
    EXPECT_THAT(ExpSim3(-twist) * (ExpSim3(twist) * in_a), VectorNear(in_a, 1e-9));
  }
}

TEST(ExpSim3Test, IsThatOfRigidMotionsWithoutScale) {
  Random random(11);
  for (int i = 0; i < kTrials; ++i) {
    Vector7d twist = RandomTwist(&random);
    twist[6] = 0;
    const Sim3d similarity = ExpSim3(twist);
    EXPECT_EQ(similarity.scale, 1);
    EXPECT_THAT(Rigid3d(similarity.rotation, similarity.translation), RigidNear(ExpSE3(twist.head<6>()), 1e-7));
  }
}

TEST(ExpSim3Test, SmallTwistsMoveAPointAlongTheirGenerators) {
  // d/dt exp(t x) p at t = 0 is rho + omega x p + sigma p: what the Jacobians of similarities are made of.
  Random random(12);
  const double step = 1e-6;
  for (int i = 0; i < kTrials; ++i) {
    const Vector7d twist = RandomTwist(&random);
    const Eigen::Vector3d p = RandomVector(&random);
    const Eigen::Vector3d numeric = (ExpSim3(step * twist) * p - ExpSim3(-step * twist) * p) / (2 * step);
    const Eigen::Vector3d expected = twist.head<3>() + Eigen::Vector3d(twist.segment<3>(3)).cross(p) + twist[6] * p;
    EXPECT_THAT(numeric, VectorNear(expected, 1e-7));
  }
}

}  // namespace
}  // namespace portolan
