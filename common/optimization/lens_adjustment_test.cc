#include "optimization/lens_adjustment.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "geometry/geometry_test_utils.h"

namespace portolan {
namespace {

/// A camera that drives a curve past points on both sides, through a lens that the problem knows nothing of.
BundleProblem DriveWith(const RadialResidual& lens, double noise, uint64_t seed) {
  Random random(seed);
  const PinholeCamera camera = TestCamera();
  BundleProblem problem;
  for (int i = 0; i < 12; ++i) {
    const Eigen::Quaterniond turn = ExpSO3({0, 0.05 * i, 0});
    const Eigen::Vector3d centre(0.2 * i + 0.02 * i * i, 0, 0.5 * i);
    problem.poses.push_back({Rigid3d(turn.conjugate(), -(turn.conjugate() * centre)), camera, i == 0});
  }
  for (int j = 0; j < 250; ++j) {
    const Eigen::Vector3d point(random.Uniform(-6, 12), random.Uniform(-3, 3), random.Uniform(4, 20));
    const auto index = static_cast<uint32_t>(problem.points_in_map.size());
    std::vector<BundleProblem::Measurement> measurements;
    for (uint32_t i = 0; i < problem.poses.size(); ++i) {
      const Eigen::Vector3d q = problem.poses[i].camera_from_map * point;
      if (q.z() < 1) continue;
      const Eigen::Vector2d xy = lens.Distort(q.hnormalized());
      const Eigen::Vector2d pixel(camera.fx * xy.x() + camera.cx, camera.fy * xy.y() + camera.cy);
      if (!camera.Contains(pixel)) continue;
      measurements.push_back({i, index, pixel + RandomNoise(&random, noise), 1.0});
    }
    if (measurements.size() < 3) continue;
    problem.points_in_map.push_back(point);
    problem.measurements.insert(problem.measurements.end(), measurements.begin(), measurements.end());
  }
  return problem;
}

BundleOptions Thorough() {
  BundleOptions options;
  options.max_iterations = 60;
  options.function_tolerance = 1e-10;
  return options;
}

TEST(AdjustLensTest, FindsTheLens) {
  const RadialResidual lens{0.06, -0.09};
  const auto exact = AdjustLens(DriveWith(lens, 0, 1), Thorough());
  ASSERT_TRUE(exact.has_value());
  EXPECT_NEAR(exact->residual.k1, lens.k1, 1e-4);
  EXPECT_NEAR(exact->residual.k2, lens.k2, 1e-3);
  const auto noisy = AdjustLens(DriveWith(lens, 0.3, 2), Thorough());
  ASSERT_TRUE(noisy.has_value());
  EXPECT_NEAR(noisy->residual.Distort({0.5, 0}).x(), lens.Distort({0.5, 0}).x(), 1e-3);  // half a pixel at the rim
  EXPECT_LT(noisy->cost_with, noisy->cost_without);
}

TEST(AdjustLensTest, TellsAWrongFocalLengthFromADistortion) {
  const auto distorted = AdjustLens(DriveWith({0.06, -0.09}, 0.3, 6), Thorough());
  ASSERT_TRUE(distorted.has_value());
  EXPECT_LT(distorted->cost_with, distorted->cost_focal);
  BundleProblem longer = DriveWith({}, 0.3, 7);
  for (BundleProblem::Pose& pose : longer.poses) {
    pose.camera.fx *= 1.08;
    pose.camera.fy *= 1.08;
  }
  const auto wrong = AdjustLens(longer, Thorough());
  ASSERT_TRUE(wrong.has_value());
  EXPECT_LT(wrong->cost_focal, wrong->cost_with);
}

TEST(AdjustLensTest, FindsNothingWhereNothingIs) {
  const auto found = AdjustLens(DriveWith({}, 0.3, 3), Thorough());
  ASSERT_TRUE(found.has_value());
  EXPECT_NEAR(found->residual.Distort({0.5, 0}).x(), 0.5, 1e-3);
  // Chance lowers twice the cost, in units of the noise, by a chi-square of two degrees of freedom: 14 once in a
  // thousand times.
  EXPECT_LT(2 * (found->cost_without - found->cost_with) / (0.3 * 0.3), 14);
}

TEST(AdjustLensTest, AnEmptyProblemGivesNothing) {
  EXPECT_FALSE(AdjustLens({}, {}).has_value());
}

TEST(AdjustLensTest, TwoCamerasAreABug) {
  BundleProblem problem = DriveWith({}, 0.3, 4);
  problem.poses.back().camera.fx += 1;
  EXPECT_THROW((void)AdjustLens(problem, {}), CheckFailure);
}

}  // namespace
}  // namespace portolan
