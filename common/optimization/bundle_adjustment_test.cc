#include "optimization/bundle_adjustment.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "base/check.h"
#include "optimization/bundle_test_problem.h"

namespace portolan {
namespace {

BundleOptions Thorough() {
  BundleOptions options;
  options.max_iterations = 50;
  options.function_tolerance = 1e-12;
  return options;
}

void ExpectUnchanged(const BundleProblem& a, const BundleProblem& b) {
  EXPECT_EQ(a.points_in_map, b.points_in_map);
  for (size_t i = 0; i < a.poses.size(); ++i) {
    EXPECT_EQ(a.poses[i].camera_from_map.translation, b.poses[i].camera_from_map.translation);
    EXPECT_EQ(a.poses[i].camera_from_map.rotation.coeffs(), b.poses[i].camera_from_map.rotation.coeffs());
  }
}

class AdjustBundleTest : public testing::TestWithParam<int> {};

TEST_P(AdjustBundleTest, ExactMeasurementsLeadToTheTruth) {
  const BundleProblem truth = MakeProblem(GetParam(), 2, 30 * GetParam(), 0, 1);
  BundleProblem problem = Disturbed(truth, 2);
  const BundleSummary summary = AdjustBundle(&problem, Thorough(), nullptr);
  ASSERT_TRUE(summary.converged_or_stopped);
  EXPECT_FALSE(summary.interrupted);
  EXPECT_LT(summary.final_cost, 1e-8 * summary.initial_cost);
  for (size_t i = 0; i < truth.poses.size(); ++i) {
    EXPECT_THAT(problem.poses[i].camera_from_map, RigidNear(truth.poses[i].camera_from_map, 1e-4));
  }
}

/// Dense and sparse Schur complements.
INSTANTIATE_TEST_SUITE_P(Sizes, AdjustBundleTest, testing::Values(3, 10, 130));

TEST(AdjustBundleCasesTest, NoiseLeavesTheCostOfItsDegreesOfFreedom) {
  const BundleProblem truth = MakeProblem(8, 2, 200, 1, 3);
  BundleProblem problem = Disturbed(truth, 4);
  BundleOptions options = Thorough();
  options.robust = false;
  const BundleSummary summary = AdjustBundle(&problem, options, nullptr);
  ASSERT_TRUE(summary.converged_or_stopped);
  const double degrees = 2.0 * static_cast<double>(truth.measurements.size()) - 3 * 200 - 6 * 6;
  EXPECT_NEAR(2 * summary.final_cost, degrees, 4 * std::sqrt(2 * degrees));  // a chi-square: 4 standard deviations
}

TEST(AdjustBundleCasesTest, TheLossHoldsAgainstOutliers) {
  const BundleProblem truth = MakeProblem(8, 2, 200, 0.5, 5);
  BundleProblem problem = Disturbed(truth, 6);
  Random random(7);
  for (size_t i = 0; i < problem.measurements.size(); i += 20)
    problem.measurements[i].pixel_px = RandomPixel(&random, TestCamera());
  BundleProblem plain = problem;
  ASSERT_TRUE(AdjustBundle(&problem, Thorough(), nullptr).converged_or_stopped);
  BundleOptions options = Thorough();
  options.robust = false;
  ASSERT_TRUE(AdjustBundle(&plain, options, nullptr).converged_or_stopped);
  double robust_error = 0, plain_error = 0;
  for (size_t i = 0; i < truth.poses.size(); ++i) {
    robust_error += (problem.poses[i].camera_from_map.translation - truth.poses[i].camera_from_map.translation).norm();
    plain_error += (plain.poses[i].camera_from_map.translation - truth.poses[i].camera_from_map.translation).norm();
  }
  EXPECT_LT(robust_error / 6, 0.02);
  EXPECT_LT(robust_error, 0.2 * plain_error);
}

TEST(AdjustBundleCasesTest, FixedPosesStayBitForBit) {
  const BundleProblem before = Disturbed(MakeProblem(6, 3, 100, 1, 8), 9);
  BundleProblem problem = before;
  ASSERT_TRUE(AdjustBundle(&problem, {}, nullptr).converged_or_stopped);
  for (size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(problem.poses[i].camera_from_map.translation, before.poses[i].camera_from_map.translation);
    EXPECT_EQ(problem.poses[i].camera_from_map.rotation.coeffs(), before.poses[i].camera_from_map.rotation.coeffs());
  }
}

TEST(AdjustBundleCasesTest, OnlyPointsAreFree) {
  const BundleProblem truth = MakeProblem(4, 4, 50, 0, 10);
  BundleProblem problem = Disturbed(truth, 11);
  ASSERT_TRUE(AdjustBundle(&problem, Thorough(), nullptr).converged_or_stopped);
  for (const BundleProblem::Measurement& m : problem.measurements) EXPECT_LT(NormalizedSquaredError(problem, m), 1e-6);
}

TEST(AdjustBundleCasesTest, UnobservedPosesAndPointsStay) {
  BundleProblem problem = Disturbed(MakeProblem(5, 2, 60, 0.5, 12), 13);
  problem.points_in_map.emplace_back(1, 2, 3);
  problem.poses.push_back({Rigid3d(Eigen::Quaterniond::Identity(), {4, 5, 6}), TestCamera(), false});
  ASSERT_TRUE(AdjustBundle(&problem, {}, nullptr).converged_or_stopped);
  EXPECT_EQ(problem.points_in_map.back(), Eigen::Vector3d(1, 2, 3));
  EXPECT_THAT(problem.poses.back().camera_from_map,
              RigidNear(Rigid3d(Eigen::Quaterniond::Identity(), {4, 5, 6}), 1e-12));
}

TEST(AdjustBundleCasesTest, PointsBehindACameraDoNotSpoilTheRest) {
  const BundleProblem truth = MakeProblem(5, 2, 100, 0, 14);
  BundleProblem problem = Disturbed(truth, 15);
  problem.points_in_map.emplace_back(0, 0, -5);
  const auto behind = static_cast<uint32_t>(problem.points_in_map.size() - 1);
  for (uint32_t i = 0; i < 3; ++i) problem.measurements.push_back({i, behind, {300, 200}, 1});
  ASSERT_TRUE(AdjustBundle(&problem, Thorough(), nullptr).converged_or_stopped);
  for (size_t i = 0; i < truth.poses.size(); ++i) {
    EXPECT_THAT(problem.poses[i].camera_from_map, RigidNear(truth.poses[i].camera_from_map, 1e-4));
  }
  EXPECT_TRUE(std::isinf(NormalizedSquaredError(problem, problem.measurements.back())));
}

TEST(AdjustBundleCasesTest, StopFlagInterruptsAndLeavesASoundState) {
  const BundleProblem before = Disturbed(MakeProblem(6, 2, 100, 1, 16), 17);
  BundleProblem problem = before;
  const std::atomic<bool> stop{true};
  const BundleSummary summary = AdjustBundle(&problem, Thorough(), &stop);
  EXPECT_TRUE(summary.interrupted);
  EXPECT_TRUE(summary.converged_or_stopped);
  EXPECT_LE(summary.final_cost, summary.initial_cost);
  EXPECT_LE(summary.iterations, 1);
}

TEST(AdjustBundleCasesTest, LoweredFlagDoesNotInterrupt) {
  BundleProblem problem = Disturbed(MakeProblem(4, 2, 50, 1, 18), 19);
  const std::atomic<bool> stop{false};
  EXPECT_FALSE(AdjustBundle(&problem, {}, &stop).interrupted);
}

TEST(AdjustBundleCasesTest, SameProblemSameResult) {
  const BundleProblem start = Disturbed(MakeProblem(6, 2, 100, 1, 20), 21);
  BundleProblem one = start, two = start;
  (void)AdjustBundle(&one, {}, nullptr);
  (void)AdjustBundle(&two, {}, nullptr);
  ExpectUnchanged(one, two);
}

TEST(AdjustBundleCasesTest, UnusableProblemsAreRefusedUnchanged) {
  const BundleProblem sound = MakeProblem(4, 2, 30, 1, 22);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  std::vector<BundleProblem> problems(5, sound);
  problems[0].measurements.clear();
  problems[1].measurements[3].pixel_px.x() = nan;
  problems[2].measurements[3].sigma_px = 0;
  problems[3].points_in_map[7].z() = std::numeric_limits<double>::infinity();
  problems[4].poses[3].camera_from_map.translation.y() = nan;
  for (size_t i = 0; i < problems.size(); ++i) {
    BundleProblem problem = problems[i];
    EXPECT_FALSE(AdjustBundle(&problem, {}, nullptr).converged_or_stopped) << "problem " << i;
    if (i < 3) ExpectUnchanged(problem, problems[i]);  // the others hold a NaN, which equals nothing
  }
}

TEST(AdjustBundleCasesTest, BrokenContractsAreBugs) {
  BundleProblem problem = MakeProblem(3, 0, 30, 1, 23);
  EXPECT_THROW((void)AdjustBundle(&problem, {}, nullptr), CheckFailure);
  problem = MakeProblem(3, 1, 30, 1, 23);
  problem.measurements[0].point = 30;
  EXPECT_THROW((void)AdjustBundle(&problem, {}, nullptr), CheckFailure);
}

TEST(NormalizedSquaredErrorTest, IsInUnitsOfSigma) {
  BundleProblem problem = MakeProblem(1, 1, 10, 0, 24);
  BundleProblem::Measurement measurement = problem.measurements[0];
  measurement.sigma_px = 2;
  measurement.pixel_px += Eigen::Vector2d(6, 8);
  EXPECT_NEAR(NormalizedSquaredError(problem, measurement), 25, 1e-9);
}

}  // namespace
}  // namespace portolan
