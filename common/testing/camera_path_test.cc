#include "testing/camera_path.h"

#include <gmock/gmock.h>

#include "base/check.h"
#include "testing/matchers.h"

namespace portolan {
namespace {

TEST(WorldFromCamera, LooksAlongTheYawWithTheImageUpright) {
  CameraStance stance;
  stance.position_in_world = {1, 2, 3};
  stance.yaw = M_PI / 2;
  const Rigid3d world_from_camera = WorldFromCamera(stance);
  const auto expect_direction = [&](const Eigen::Vector3d& in_camera, const Eigen::Vector3d& in_world) {
    EXPECT_LT((world_from_camera.rotation * in_camera - in_world).norm(), 1e-12) << in_camera.transpose();
  };
  expect_direction({0, 0, 1}, {0, 1, 0});   // ahead
  expect_direction({1, 0, 0}, {1, 0, 0});   // right
  expect_direction({0, 1, 0}, {0, 0, -1});  // down
  EXPECT_EQ(world_from_camera.translation, stance.position_in_world);
}

TEST(WorldFromCamera, PitchLooksUpAndRollTurnsTheCameraClockwise) {
  CameraStance stance;
  stance.pitch = 0.3;
  EXPECT_NEAR((WorldFromCamera(stance).rotation * Eigen::Vector3d::UnitZ()).z(), std::sin(0.3), 1e-12);
  stance.pitch = 0;
  stance.roll = 0.2;  // the camera's right side goes down
  EXPECT_NEAR((WorldFromCamera(stance).rotation * Eigen::Vector3d::UnitX()).z(), -std::sin(0.2), 1e-12);
}

TEST(CameraPath, StaysExactlyWhereItsStancesStay) {
  CameraStance stance;
  stance.position_in_world = {1, 2, 3};
  stance.yaw = 0.7;
  const CameraPath path({stance, stance, stance, stance}, 0.5);
  for (const double t : {0.0, 0.2, 0.9, 1.5, 9.0}) {
    EXPECT_THAT(path.At(t), RigidNear(WorldFromCamera(stance), PoseTolerance{1e-12, 1e-12}));
  }
}

TEST(CameraPath, IsUniformAlongUniformStancesAndTurnsTheShortWay) {
  std::vector<CameraStance> stances(8);
  for (int i = 0; i < 8; ++i) {
    stances[static_cast<size_t>(i)].position_in_world = {0.5 * i, 0, 0};
    stances[static_cast<size_t>(i)].yaw = std::remainder(2.9 + 0.1 * i, 2 * M_PI);  // passes pi
  }
  const CameraPath path(stances, 0.25);
  CameraStance expected;
  for (double t = 0.25; t < 1.5; t += 0.1) {
    expected.position_in_world = {2 * t, 0, 0};
    expected.yaw = 2.9 + 0.4 * t;
    EXPECT_THAT(path.At(t), RigidNear(WorldFromCamera(expected), PoseTolerance{1e-9, 1e-9})) << t;
  }
}

TEST(CameraPath, RefusesTooFewStances) {
  EXPECT_THROW(CameraPath({CameraStance()}, 1), CheckFailure);
  EXPECT_THROW(CameraPath({CameraStance(), CameraStance()}, 0), CheckFailure);
}

TEST(RoadPath, RoundsACornerInOneAndAHalfToThreeSecondsWhileMoving) {
  const RoadOptions options;
  const CameraPath path = MakeRoadPath({{0, 0}, {40, 0}, {40, 40}}, options);
  double first_s = -1, last_s = -1;  // when the direction of motion turns
  constexpr double kStep = 0.05;
  for (double t = 0.5; t + kStep < path.duration_s(); t += kStep) {
    const Eigen::Vector3d way = path.At(t + kStep).translation - path.At(t).translation;
    EXPECT_GT(way.norm() / kStep, 0.9 * options.corner_speed);
    EXPECT_LT(way.norm() / kStep, 1.1 * options.speed);
    const double heading = std::atan2(way.y(), way.x());
    if (heading < 0.1) first_s = t;
    if (heading < M_PI / 2 - 0.1) last_s = t;
  }
  EXPECT_GT(last_s - first_s, 1.5);
  EXPECT_LT(last_s - first_s, 3.0);
  EXPECT_LT((path.At(path.duration_s()).translation - Eigen::Vector3d(40, 40, options.camera_height)).norm(), 1.0);
}

TEST(RoadPath, RefusesLegsTooShortForTheirCorners) {
  EXPECT_THROW(MakeRoadPath({{0, 0}, {4, 0}, {4, 40}}, RoadOptions()), CheckFailure);
}

}  // namespace
}  // namespace portolan
