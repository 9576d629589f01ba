#include "optimization/reprojection_cost.h"

#include <gtest/gtest.h>

#include <cmath>

#include "geometry/geometry_test_utils.h"

namespace portolan {
namespace {

constexpr double kStep = 1e-6;
constexpr double kSigma = 1.7;

/// A posed camera, moved away from its reference, and a point in its view.
struct PosedPoint {
  explicit PosedPoint(uint64_t seed) : random(seed), pose(RandomRigid(&random)) {
    for (int k = 0; k < 6; ++k) pose.parameters()[k] = 0.3 * random.Gaussian();
    pose.Prepare();
    point = pose.CameraFromMap().Inverse() * RandomPointInView(&random, camera, 2, 8);
    measurement = {RandomPixel(&random, camera), 1 / kSigma};
  }
  Random random;
  PinholeCamera camera = TestCamera();
  PoseUpdate pose;
  Eigen::Vector3d point;
  PixelMeasurement measurement;
};

Eigen::Vector2d Residual(PosedPoint* setup) {
  setup->pose.Prepare();
  const ReprojectionCost cost(&setup->pose, &setup->camera, setup->measurement);
  const double* parameters[] = {setup->pose.parameters(), setup->point.data()};
  Eigen::Vector2d residual;
  EXPECT_TRUE(cost.Evaluate(parameters, residual.data(), nullptr));
  return residual;
}

/// Central difference by one parameter.
Eigen::Vector2d NumericDerivative(PosedPoint* setup, double* parameter) {
  const double value = *parameter;
  *parameter = value + kStep;
  const Eigen::Vector2d plus = Residual(setup);
  *parameter = value - kStep;
  const Eigen::Vector2d minus = Residual(setup);
  *parameter = value;
  setup->pose.Prepare();
  return (plus - minus) / (2 * kStep);
}

TEST(PoseUpdateTest, StartsAtItsReference) {
  Random random(1);
  const Rigid3d camera_from_map = RandomRigid(&random);
  const PoseUpdate pose(camera_from_map);
  EXPECT_THAT(pose.CameraFromMap(), RigidNear(camera_from_map, 1e-7));
}

TEST(PoseUpdateTest, PreparedMatrixIsThePose) {
  PosedPoint setup(2);
  const Eigen::Vector3d x = RandomVector(&setup.random);
  EXPECT_THAT(Eigen::Vector3d(setup.pose.rotation() * x + setup.pose.translation()),
              VectorNear(Eigen::Vector3d(setup.pose.CameraFromMap() * x), 1e-12));
}

TEST(ReprojectionCostTest, ResidualIsTheErrorInSigmas) {
  PosedPoint setup(3);
  const Eigen::Vector2d projected = setup.camera.Project(setup.pose.CameraFromMap() * setup.point);
  EXPECT_THAT(Residual(&setup), VectorNear(Eigen::Vector2d((projected - setup.measurement.pixel_px) / kSigma), 1e-9));
}

TEST(ReprojectionCostTest, JacobiansAreTheNumericOnes) {
  for (uint64_t seed = 4; seed < 14; ++seed) {
    PosedPoint setup(seed);
    const ReprojectionCost cost(&setup.pose, &setup.camera, setup.measurement);
    const double* parameters[] = {setup.pose.parameters(), setup.point.data()};
    Eigen::Matrix<double, 2, 6, Eigen::RowMajor> by_pose;
    Eigen::Matrix<double, 2, 3, Eigen::RowMajor> by_point;
    double* jacobians[] = {by_pose.data(), by_point.data()};
    Eigen::Vector2d residual;
    ASSERT_TRUE(cost.Evaluate(parameters, residual.data(), jacobians));
    const double tolerance = 1e-6 * by_pose.norm();
    for (int k = 0; k < 6; ++k) {
      EXPECT_THAT(Eigen::Vector2d(by_pose.col(k)),
                  VectorNear(NumericDerivative(&setup, setup.pose.parameters() + k), tolerance));
    }
    for (int k = 0; k < 3; ++k) {
      EXPECT_THAT(Eigen::Vector2d(by_point.col(k)),
                  VectorNear(NumericDerivative(&setup, setup.point.data() + k), tolerance));
    }
  }
}

TEST(ReprojectionCostTest, FixedPoseGivesTheSameResidualAndPointJacobian) {
  PosedPoint setup(20);
  const ReprojectionCost free_cost(&setup.pose, &setup.camera, setup.measurement);
  const FixedPoseReprojectionCost fixed_cost(&setup.pose, &setup.camera, setup.measurement);
  const double* free_parameters[] = {setup.pose.parameters(), setup.point.data()};
  const double* fixed_parameters[] = {setup.point.data()};
  Eigen::Matrix<double, 2, 3, Eigen::RowMajor> free_jacobian, fixed_jacobian;
  double* free_jacobians[] = {nullptr, free_jacobian.data()};
  double* fixed_jacobians[] = {fixed_jacobian.data()};
  Eigen::Vector2d free_residual, fixed_residual;
  ASSERT_TRUE(free_cost.Evaluate(free_parameters, free_residual.data(), free_jacobians));
  ASSERT_TRUE(fixed_cost.Evaluate(fixed_parameters, fixed_residual.data(), fixed_jacobians));
  EXPECT_EQ(free_residual, fixed_residual);
  EXPECT_EQ(free_jacobian, fixed_jacobian);
}

TEST(ReprojectionCostTest, BehindTheCameraIsAConstantError) {
  PosedPoint setup(21);
  setup.point = setup.pose.CameraFromMap().Inverse() * Eigen::Vector3d(0.1, 0.1, -2);
  const ReprojectionCost cost(&setup.pose, &setup.camera, setup.measurement);
  const double* parameters[] = {setup.pose.parameters(), setup.point.data()};
  Eigen::Matrix<double, 2, 6, Eigen::RowMajor> by_pose;
  Eigen::Matrix<double, 2, 3, Eigen::RowMajor> by_point;
  double* jacobians[] = {by_pose.data(), by_point.data()};
  Eigen::Vector2d residual;
  ASSERT_TRUE(cost.Evaluate(parameters, residual.data(), jacobians));
  EXPECT_EQ(residual, Eigen::Vector2d::Constant(kBehindCameraResidual));
  EXPECT_TRUE(by_pose.isZero());
  EXPECT_TRUE(by_point.isZero());
}

}  // namespace
}  // namespace portolan
