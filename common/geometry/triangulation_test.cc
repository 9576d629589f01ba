#include "geometry/triangulation.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>
#include <limits>

#include "geometry/geometry_test_utils.h"

namespace portolan {
namespace {

constexpr int kTrials = 200;

/// A point seen by two cameras.
struct Pair {
  Rigid3d first_from_map, second_from_map;
  Eigen::Vector3d point_in_map;
  Eigen::Vector2d first_px, second_px;

  Rigid3d second_from_first() const { return second_from_map * first_from_map.Inverse(); }
};

Pair RandomPair(Random* random, double baseline = 0.5) {
  const PinholeCamera camera = TestCamera();
  while (true) {
    Pair pair;
    pair.first_from_map = RandomRigid(random, 1, 10);
    pair.second_from_map = RandomRigid(random, 0.1, baseline) * pair.first_from_map;
    pair.point_in_map = pair.first_from_map.Inverse() * RandomPointInView(random, camera, 3, 10);
    const Eigen::Vector3d in_second = pair.second_from_map * pair.point_in_map;
    if (in_second.z() < 0.5) continue;
    pair.first_px = camera.Project(pair.first_from_map * pair.point_in_map);
    pair.second_px = camera.Project(in_second);
    return pair;
  }
}

double EpipolarDistance(const Eigen::Matrix3d& F, const Eigen::Vector2d& first, const Eigen::Vector2d& second) {
  const Eigen::Vector3d line = F * first.homogeneous();
  return std::abs(line.dot(second.homogeneous())) / line.head<2>().norm();
}

TEST(FundamentalFromMotionTest, ExactMatchesMeetTheConstraint) {
  Random random(1);
  PinholeCamera second_camera = TestCamera();
  second_camera.fx = 700;
  second_camera.cy = 100;
  for (int i = 0; i < kTrials; ++i) {
    const Pair pair = RandomPair(&random);
    const Eigen::Matrix3d F = FundamentalFromMotion(pair.second_from_first(), TestCamera(), second_camera);
    EXPECT_LT(EpipolarDistance(F, pair.first_px, second_camera.Project(pair.second_from_map * pair.point_in_map)),
              1e-8);
  }
}

TEST(CorrectMatchTest, LeavesExactMatchesAlone) {
  Random random(2);
  for (int i = 0; i < kTrials; ++i) {
    const Pair pair = RandomPair(&random);
    const Eigen::Matrix3d F = FundamentalFromMotion(pair.second_from_first(), TestCamera(), TestCamera());
    const auto [first, second] = CorrectMatch(F, pair.first_px, pair.second_px);
    EXPECT_THAT(first, VectorNear(pair.first_px, 1e-5));
    EXPECT_THAT(second, VectorNear(pair.second_px, 1e-5));
  }
}

TEST(CorrectMatchTest, CorrectedMatchesMeetTheConstraintExactly) {
  Random random(3);
  for (const double noise_px : {0.1, 1.0, 10.0, 100.0}) {
    for (int i = 0; i < kTrials; ++i) {
      const Pair pair = RandomPair(&random);
      const Eigen::Matrix3d F = FundamentalFromMotion(pair.second_from_first(), TestCamera(), TestCamera());
      const auto [first, second] = CorrectMatch(F, pair.first_px + RandomNoise(&random, noise_px),
                                                pair.second_px + RandomNoise(&random, noise_px));
      EXPECT_LT(EpipolarDistance(F, first, second), 1e-6);
    }
  }
}

/// The least d^2 + d'^2 of paper Eq. (10) over the epipolar lines through a circle of one pixel around the first point:
/// all lines at most one pixel away from it.
double BruteForceCost(const Eigen::Matrix3d& F, const Eigen::Vector2d& first, const Eigen::Vector2d& second) {
  const Eigen::FullPivLU<Eigen::Matrix3d> lu(F);
  const Eigen::Vector3d epipole = lu.kernel().col(0);
  const auto cost = [&](double angle) {
    const Eigen::Vector3d line1 =
        epipole.cross(Eigen::Vector3d(first.x() + std::cos(angle), first.y() + std::sin(angle), 1));
    const Eigen::Vector3d line2 = F * Eigen::Vector3d(first.x() + std::cos(angle), first.y() + std::sin(angle), 1);
    const double d1 = line1.dot(first.homogeneous()) / line1.head<2>().norm();
    const double d2 = line2.dot(second.homogeneous()) / line2.head<2>().norm();
    return d1 * d1 + d2 * d2;
  };
  constexpr int kSteps = 20000;
  double best = std::numeric_limits<double>::infinity();
  for (int i = 0; i < kSteps; ++i) best = std::min(best, cost(2 * M_PI * i / kSteps));
  return best;
}

TEST(CorrectMatchTest, NoLineOfThePencilIsNearer) {
  Random random(4);
  for (int i = 0; i < 20; ++i) {
    const Pair pair = RandomPair(&random);
    const Eigen::Matrix3d F = FundamentalFromMotion(pair.second_from_first(), TestCamera(), TestCamera());
    const Eigen::Vector2d first_px = pair.first_px + RandomNoise(&random, 0.3);
    const Eigen::Vector2d second_px = pair.second_px + RandomNoise(&random, 0.3);
    const auto [first, second] = CorrectMatch(F, first_px, second_px);
    const double cost = (first - first_px).squaredNorm() + (second - second_px).squaredNorm();
    const double brute_force = BruteForceCost(F, first_px, second_px);
    EXPECT_LE(cost, brute_force + 1e-9);
    EXPECT_NEAR(cost, brute_force, 1e-3);
  }
}

TEST(CorrectMatchTest, MeasuredPointsComeBackFromADegenerateMatrix) {
  const Eigen::Vector2d first(1, 2), second(3, 4);
  for (const Eigen::Matrix3d& F :
       {Eigen::Matrix3d(Eigen::Matrix3d::Zero()),
        Eigen::Matrix3d(Eigen::Matrix3d::Constant(std::numeric_limits<double>::quiet_NaN()))}) {
    const auto [corrected_first, corrected_second] = CorrectMatch(F, first, second);
    EXPECT_EQ(corrected_first, first);
    EXPECT_EQ(corrected_second, second);
  }
}

TEST(CorrectMatchTest, PointAtTheEpipoleStaysFinite) {
  const PinholeCamera camera = TestCamera();
  const Eigen::Matrix3d F = FundamentalFromMotion(Rigid3d(Eigen::Quaterniond::Identity(), {0, 0, -1}), camera, camera);
  const auto [first, second] = CorrectMatch(F, {camera.cx, camera.cy}, {camera.cx + 1, camera.cy});
  EXPECT_TRUE(first.allFinite());
  EXPECT_TRUE(second.allFinite());
}

TEST(TriangulateDltTest, ExactMatchesGiveThePoint) {
  Random random(5);
  const PinholeCamera camera = TestCamera();
  for (int i = 0; i < kTrials; ++i) {
    const Pair pair = RandomPair(&random);
    const auto point = TriangulateDlt(pair.first_from_map, pair.second_from_map, camera.Normalize(pair.first_px),
                                      camera.Normalize(pair.second_px));
    ASSERT_TRUE(point.has_value());
    EXPECT_THAT(*point, VectorNear(pair.point_in_map, 1e-6));
  }
}

TEST(TriangulateDltTest, DoesNotDependOnTheUnitOfLengthNorOnThePlaceInTheMap) {
  Random random(6);
  const PinholeCamera camera = TestCamera();
  const Pair pair = RandomPair(&random);
  for (const double scale : {1e-4, 1e4}) {
    const auto scaled = [&](Rigid3d pose) {
      pose.translation *= scale;
      return pose;
    };
    const auto point = TriangulateDlt(scaled(pair.first_from_map), scaled(pair.second_from_map),
                                      camera.Normalize(pair.first_px), camera.Normalize(pair.second_px));
    ASSERT_TRUE(point.has_value());
    EXPECT_THAT(*point, VectorNear(Eigen::Vector3d(scale * pair.point_in_map), 1e-6 * scale));
  }
}

TEST(TriangulateDltTest, NoiseOfTheCorrectedMatchMovesThePointAsFarAsPredicted) {
  Random random(7);
  const PinholeCamera camera = TestCamera();
  const Rigid3d second_from_first(Eigen::Quaterniond::Identity(), {-1, 0, 0});
  const Eigen::Matrix3d F = FundamentalFromMotion(second_from_first, camera, camera);
  const Eigen::Vector3d truth(0.2, 0.1, 5);
  double sum = 0;
  for (int i = 0; i < 1000; ++i) {
    const auto [first, second] = CorrectMatch(F, camera.Project(truth) + RandomNoise(&random, 1),
                                              camera.Project(second_from_first * truth) + RandomNoise(&random, 1));
    const auto point = TriangulateDlt(Rigid3d(), second_from_first, camera.Normalize(first), camera.Normalize(second));
    ASSERT_TRUE(point.has_value());
    sum += (point->z() - truth.z()) * (point->z() - truth.z());
  }
  // depth = f b / disparity, so sigma = depth^2 / (f b) * sqrt(2) sigma_px
  EXPECT_NEAR(std::sqrt(sum / 1000), 25.0 / 500 * M_SQRT2, 0.1 * 25.0 / 500 * M_SQRT2);
}

TEST(TriangulateDltTest, ParallelRaysAndEqualCentresGiveNone) {
  const Rigid3d second_from_first(Eigen::Quaterniond::Identity(), {-1, 0, 0});
  EXPECT_FALSE(TriangulateDlt(Rigid3d(), second_from_first, {0.1, 0.2}, {0.1, 0.2}).has_value());
  EXPECT_FALSE(TriangulateDlt(second_from_first, second_from_first, {0.1, 0.2}, {0.2, 0.2}).has_value());
  EXPECT_FALSE(TriangulateDlt(Rigid3d(), second_from_first, {std::nan(""), 0.2}, {0.1, 0.2}).has_value());
}

TEST(TriangulateDltTest, DivergingRaysMeetBehindTheCameras) {
  const Rigid3d second_from_first(Eigen::Quaterniond::Identity(), {-1, 0, 0});
  const auto point = TriangulateDlt(Rigid3d(), second_from_first, {-0.1, 0}, {0.1, 0});
  ASSERT_TRUE(point.has_value());
  EXPECT_LT(point->z(), 0);
}

TEST(ParallaxCosineTest, RightAngleAndNoAngle) {
  EXPECT_NEAR(ParallaxCosine({1, 0, 0}, {-1, 0, 0}, {0, 0, 1}), 0, 1e-12);
  EXPECT_NEAR(ParallaxCosine({0, 0, 1}, {0, 0, 2}, {0, 0, 5}), 1, 1e-12);
}

}  // namespace
}  // namespace portolan
