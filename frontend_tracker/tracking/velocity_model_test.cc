#include "tracking/velocity_model.h"

#include <gtest/gtest.h>

#include "base/check.h"

namespace portolan {
namespace {

constexpr double kStep = 0.1;  // seconds between frames

Timestamp At(int frame) {
  return Timestamp::FromSeconds(5 + kStep * frame);
}

Vector6d Twist(double scale) {
  Vector6d twist;
  twist << 1, -2, 3, 0.1, 0.2, -0.3;
  return scale * twist;
}

TEST(VelocityModel, FollowsEquationOne) {
  // A camera that moves by twists of its own choice; the velocity is the paper's recursion.
  const double speeds[] = {1.0, 0.5, 2.0, 0.0, -1.0};
  VelocityModel model;
  Rigid3d pose(ExpSO3({0.3, 0, 0.1}), {1, 2, 3});
  model.Update(At(0), pose);
  Vector6d expected;
  for (int i = 0; i < 5; ++i) {
    pose = ExpSE3(kStep * Twist(speeds[i])) * pose;
    model.Update(At(i + 1), pose);
    expected = i == 0 ? Vector6d(0.9 * Twist(speeds[0])) : Vector6d(0.9 * (expected + Twist(speeds[i])) / 2);
    EXPECT_LT((model.velocity() - expected).norm(), 1e-9) << "frame " << i + 1;
  }
}

TEST(VelocityModel, PredictsByEquationTwo) {
  VelocityModel model;
  Rigid3d pose(ExpSO3({0.3, 0, 0.1}), {1, 2, 3});
  model.Update(At(0), pose);
  pose = ExpSE3(kStep * Twist(1)) * pose;
  model.Update(At(1), pose);
  const Rigid3d expected = ExpSE3(2 * kStep * 0.9 * Twist(1)) * pose;
  const Rigid3d predicted = model.Predict(At(3));
  EXPECT_LT(predicted.rotation.angularDistance(expected.rotation), 1e-9);
  EXPECT_LT((predicted.translation - expected.translation).norm(), 1e-9);
}

TEST(VelocityModel, ConstantVelocityIsThatOfTheLastTwoPoses) {
  VelocityModel model(false);
  Rigid3d pose(ExpSO3({0.3, 0, 0.1}), {1, 2, 3});
  for (int i = 0; i < 4; ++i) {
    model.Update(At(i), pose);
    pose = ExpSE3(kStep * Twist(1 + i)) * pose;
  }
  EXPECT_LT((model.velocity() - Twist(3)).norm(), 1e-9);
  model.Reset();
  model.Update(At(4), Rigid3d());
  model.Update(At(5), ExpSE3(kStep * Twist(2)));
  EXPECT_LT((model.velocity() - Twist(2)).norm(), 1e-9) << "it stays of this kind";
}

TEST(VelocityModel, DecaysWhenTheCameraStops) {
  VelocityModel model;
  model.Update(At(0), Rigid3d());
  model.Update(At(1), ExpSE3(kStep * Twist(1)));
  double last = model.velocity().norm();
  for (int i = 2; i < 8; ++i) {
    model.Update(At(i), ExpSE3(kStep * Twist(1)));
    EXPECT_NEAR(model.velocity().norm(), 0.45 * last, 1e-9);
    last = model.velocity().norm();
  }
}

TEST(VelocityModel, FirstPredictionIsThePoseItself) {
  VelocityModel model;
  EXPECT_THROW(static_cast<void>(model.Predict(At(0))), CheckFailure);
  const Rigid3d pose(ExpSO3({0.3, 0, 0.1}), {1, 2, 3});
  model.Update(At(0), pose);
  EXPECT_LT((model.Predict(At(1)).translation - pose.translation).norm(), 1e-12);
}

TEST(VelocityModel, GapsAndTimesThatStandStillGiveNoVelocity) {
  VelocityModel model;
  const auto start = [&] {
    model.Reset();
    model.Update(At(0), Rigid3d());
    model.Update(At(1), ExpSE3(kStep * Twist(1)));
    ASSERT_GT(model.velocity().norm(), 0);
  };
  start();
  model.Update(At(30), Rigid3d());  // 2.9 s later
  EXPECT_EQ(model.velocity().norm(), 0);
  start();
  model.Update(At(1), Rigid3d());
  EXPECT_EQ(model.velocity().norm(), 0);
  start();
  EXPECT_LT((model.Predict(At(60)).translation - model.last_camera_from_map().translation).norm(), 1e-12);
  model.Reset();
  EXPECT_FALSE(model.has_pose());
}

TEST(VelocityModel, MovesWithTheMap) {
  // The same motion, told in the map as it was and as it is: predictions agree.
  const Sim3d new_from_old(0.7, ExpSO3({0.2, 0.1, -0.5}), {1, -2, 4});
  VelocityModel moved, expected;
  Rigid3d pose(ExpSO3({0.3, 0, 0.1}), {1, 2, 3});
  for (int i = 0; i < 3; ++i) {
    moved.Update(At(i), pose);
    expected.Update(At(i), TransformPose(pose, new_from_old));
    pose = ExpSE3(kStep * Twist(1)) * pose;
  }
  moved.MoveWithMap(new_from_old);
  EXPECT_LT((moved.velocity() - expected.velocity()).norm(), 1e-9);
  EXPECT_LT((moved.Predict(At(3)).translation - expected.Predict(At(3)).translation).norm(), 1e-9);
}

}  // namespace
}  // namespace portolan
