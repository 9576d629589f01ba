#include "optimization/pose_optimization.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <limits>

#include "base/check.h"
#include "geometry/geometry_test_utils.h"

namespace portolan {
namespace {

struct View {
  Rigid3d camera_from_map;
  PoseMatches matches;
  std::vector<bool> is_outlier;
};

View RandomView(uint64_t seed, int n, double noise, double outliers) {
  const PinholeCamera camera = TestCamera();
  Random random(seed);
  View view;
  view.camera_from_map = RandomRigid(&random, 1, 5);
  for (int i = 0; i < n; ++i) {
    const Eigen::Vector3d in_camera = RandomPointInView(&random, camera, 2, 15);
    const double sigma = std::pow(1.2, static_cast<double>(random.Below(8)));
    view.is_outlier.push_back(random.Uniform() < outliers);
    view.matches.landmarks_in_map.push_back(view.camera_from_map.Inverse() * in_camera);
    view.matches.pixels_px.push_back(
        view.is_outlier.back() ? RandomPixel(&random, camera)
                               : Eigen::Vector2d(camera.Project(in_camera) + RandomNoise(&random, noise * sigma)));
    view.matches.sigmas_px.push_back(sigma);
  }
  return view;
}

Rigid3d Displaced(const Rigid3d& camera_from_map, double translation, double rotation) {
  Vector6d twist;
  twist << translation, -translation, translation, rotation, rotation, -rotation;
  return ExpSE3(twist) * camera_from_map;
}

TEST(OptimizePoseTest, ExactMatchesLeadToThePoseFromAfar) {
  for (const uint64_t seed : {1, 2, 3}) {
    const View view = RandomView(seed, 100, 0, 0);
    const auto result = OptimizePose(TestCamera(), view.matches, Displaced(view.camera_from_map, 0.3, 0.1));
    EXPECT_THAT(result.camera_from_map, RigidNear(view.camera_from_map, 1e-6));
    EXPECT_EQ(result.num_inliers, 100);
  }
}

TEST(OptimizePoseTest, ErrorAgreesWithTheInformationMatrix) {
  // The squared error weighed by the information follows a chi-square with 6 degrees of freedom: mean 6, standard
  // deviation 3.5.
  double sum = 0;
  constexpr int kTrials = 60;
  PoseOptimizationOptions options;
  options.chi2 = 1e6;  // no truncation and no loss: plain maximum likelihood
  options.loss_width = 1e6;
  for (int seed = 1; seed <= kTrials; ++seed) {
    const View view = RandomView(seed, 200, 1, 0);
    const auto result = OptimizePose(TestCamera(), view.matches, Displaced(view.camera_from_map, 0.05, 0.02), options);
    const Vector6d error = LogSE3(result.camera_from_map * view.camera_from_map.Inverse());
    sum += error.dot(result.information * error);
  }
  EXPECT_NEAR(sum / kTrials, 6, 4 * 3.5 / std::sqrt(kTrials));
}

TEST(OptimizePoseTest, OutliersAreToldAndDoNotPull) {
  for (const uint64_t seed : {4, 5, 6}) {
    const View view = RandomView(seed, 400, 0.5, 0.4);
    const auto result = OptimizePose(TestCamera(), view.matches, Displaced(view.camera_from_map, 0.05, 0.02));
    EXPECT_THAT(result.camera_from_map, RigidNear(view.camera_from_map, 0.01));
    int wrong = 0, inliers = 0;
    for (size_t i = 0; i < view.is_outlier.size(); ++i) {
      wrong += result.inliers[i] == view.is_outlier[i] ? 1 : 0;
      inliers += result.inliers[i] ? 1 : 0;
    }
    EXPECT_LE(wrong, 4);
    EXPECT_EQ(inliers, result.num_inliers);
  }
}

TEST(OptimizePoseTest, ErrorsToOneSideHardlyPull) {
  // A fifth of the matches lies two sigmas to the right, well within the gate, as the next stone of a pavement would.
  View view = RandomView(10, 400, 0.1, 0);
  for (size_t i = 0; i < 80; ++i) view.matches.pixels_px[i].x() += 2 * view.matches.sigmas_px[i];
  PoseOptimizationOptions least_squares;
  least_squares.loss_width = 1e6;
  const auto turn = [&](const PoseOptimizationOptions& options) {
    const auto result = OptimizePose(TestCamera(), view.matches, view.camera_from_map, options);
    return LogSO3(result.camera_from_map.rotation * view.camera_from_map.rotation.conjugate()).norm();
  };
  EXPECT_LT(turn({}), 0.2 * turn(least_squares));
}

TEST(OptimizePoseTest, AWideFirstLossSeesThroughMatchesThatAgreeWithTheStart) {
  // Features near where a prediction puts the landmarks, as a search in windows around it finds them where they are
  // not.
  for (const uint64_t seed : {11, 12, 13}) {
    View view = RandomView(seed, 400, 0.5, 0);
    const Rigid3d start = Displaced(view.camera_from_map, 0.02, 0.02);  // some 15 px off
    Random random(seed);
    for (size_t i = 0; i < 160; ++i) {
      const Eigen::Vector3d in_camera = start * view.matches.landmarks_in_map[i];
      view.matches.pixels_px[i] =
          TestCamera().Project(in_camera) + RandomNoise(&random, i < 40 ? 0.3 : 8) * view.matches.sigmas_px[i];
    }
    const auto narrow = OptimizePose(TestCamera(), view.matches, start);
    EXPECT_LT(narrow.num_inliers, 120);
    PoseOptimizationOptions options;
    options.first_loss_width = 15;
    options.rounds = 6;
    const auto wide = OptimizePose(TestCamera(), view.matches, start, options);
    EXPECT_THAT(wide.camera_from_map, RigidNear(view.camera_from_map, 0.01));
    EXPECT_GE(wide.num_inliers, 240);
  }
}

TEST(OptimizePoseTest, NoSmallMoveReducesTheCost) {
  const View view = RandomView(7, 100, 1, 0);
  PoseOptimizationOptions options;
  options.chi2 = 1e6;
  options.loss_width = 1e6;
  const auto result = OptimizePose(TestCamera(), view.matches, view.camera_from_map, options);
  const auto cost = [&](const Rigid3d& pose) {
    double sum = 0;
    for (size_t i = 0; i < view.is_outlier.size(); ++i) {
      const Eigen::Vector2d projected = TestCamera().Project(pose * view.matches.landmarks_in_map[i]);
      sum += (projected - view.matches.pixels_px[i]).squaredNorm() / std::pow(view.matches.sigmas_px[i], 2);
    }
    return sum;
  };
  const double least = cost(result.camera_from_map);
  for (int k = 0; k < 6; ++k) {
    for (const double step : {-1e-3, 1e-3})
      EXPECT_GT(cost(ExpSE3(step * Vector6d::Unit(k)) * result.camera_from_map), least);
  }
}

TEST(OptimizePoseTest, InformationIsTheNumericHessian) {
  const View view = RandomView(8, 30, 0, 0);
  const auto result = OptimizePose(TestCamera(), view.matches, view.camera_from_map);
  constexpr double kStep = 1e-6;
  Eigen::MatrixXd jacobian(60, 6);
  for (int k = 0; k < 6; ++k) {
    for (int i = 0; i < 30; ++i) {
      const auto project = [&](double step) {
        return TestCamera().Project(ExpSE3(step * Vector6d::Unit(k)) * result.camera_from_map *
                                    view.matches.landmarks_in_map[i]);
      };
      jacobian.block<2, 1>(2 * i, k) = (project(kStep) - project(-kStep)) / (2 * kStep * view.matches.sigmas_px[i]);
    }
  }
  const Matrix6d numeric = jacobian.transpose() * jacobian;
  EXPECT_LT((result.information - numeric).norm(), 1e-5 * numeric.norm());
}

TEST(OptimizePoseTest, LandmarksBehindTheCameraAreOutliers) {
  View view = RandomView(9, 50, 0, 0);
  for (int i = 0; i < 10; ++i) {  // the mirror image in the camera's centre has the same pixel
    const Eigen::Vector3d in_camera = view.camera_from_map * view.matches.landmarks_in_map[i];
    view.matches.landmarks_in_map[i] = view.camera_from_map.Inverse() * Eigen::Vector3d(-in_camera);
  }
  const auto result = OptimizePose(TestCamera(), view.matches, Displaced(view.camera_from_map, 0.01, 0.01));
  EXPECT_THAT(result.camera_from_map, RigidNear(view.camera_from_map, 1e-6));
  EXPECT_EQ(result.num_inliers, 40);
  EXPECT_FALSE(result.inliers[3]);
}

TEST(OptimizePoseTest, NonFiniteMatchesAreOutliers) {
  View view = RandomView(10, 50, 0, 0);
  view.matches.landmarks_in_map[0].x() = std::nan("");
  view.matches.pixels_px[1].y() = std::numeric_limits<double>::infinity();
  view.matches.sigmas_px[2] = 0;
  const auto result = OptimizePose(TestCamera(), view.matches, Displaced(view.camera_from_map, 0.01, 0.01));
  EXPECT_THAT(result.camera_from_map, RigidNear(view.camera_from_map, 1e-6));
  EXPECT_EQ(result.num_inliers, 47);
}

TEST(OptimizePoseTest, TooFewMatchesLeaveThePoseAsItIs) {
  for (const int n : {0, 1, 2}) {
    const View view = RandomView(11, n, 0, 0);
    const Rigid3d start = Displaced(view.camera_from_map, 0.1, 0.1);
    const auto result = OptimizePose(TestCamera(), view.matches, start);
    EXPECT_THAT(result.camera_from_map, RigidNear(start, 0.0));
    EXPECT_EQ(result.num_inliers, 0);
    EXPECT_EQ(result.inliers.size(), static_cast<size_t>(n));
  }
}

TEST(OptimizePoseTest, DegenerateLandmarksGiveAFinitePose) {
  View view = RandomView(12, 20, 0, 0);
  for (Eigen::Vector3d& landmark : view.matches.landmarks_in_map) landmark = view.matches.landmarks_in_map[0];
  for (Eigen::Vector2d& pixel : view.matches.pixels_px) pixel = view.matches.pixels_px[0];
  const auto result = OptimizePose(TestCamera(), view.matches, Displaced(view.camera_from_map, 0.01, 0.01));
  EXPECT_TRUE(result.camera_from_map.translation.allFinite());
  EXPECT_TRUE(result.camera_from_map.rotation.coeffs().allFinite());
}

TEST(OptimizePoseTest, UnequalLengthsAreABug) {
  View view = RandomView(13, 20, 0, 0);
  view.matches.sigmas_px.pop_back();
  EXPECT_THROW((void)OptimizePose(TestCamera(), view.matches, view.camera_from_map), CheckFailure);
}

}  // namespace
}  // namespace portolan
