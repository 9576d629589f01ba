#include "optimization/large_bundle.h"

#include <gtest/gtest.h>

#include <limits>

#include "base/check.h"
#include "optimization/bundle_test_problem.h"

namespace portolan {
namespace {

BundleOptions Thorough() {
  BundleOptions options;
  options.max_iterations = 100;
  options.function_tolerance = 1e-12;
  return options;
}

class LargeBundleTest : public testing::TestWithParam<int> {};

TEST_P(LargeBundleTest, ExactMeasurementsLeadToTheTruth) {
  const BundleProblem truth = MakeProblem(GetParam(), 2, 30 * GetParam(), 0, 1);
  BundleProblem problem = Disturbed(truth, 2);
  const BundleSummary summary = AdjustLargeBundle(&problem, Thorough(), nullptr);
  ASSERT_TRUE(summary.converged_or_stopped);
  EXPECT_FALSE(summary.interrupted);
  EXPECT_LT(summary.final_cost, 1e-8 * summary.initial_cost);
  for (size_t i = 0; i < truth.poses.size(); ++i) {
    EXPECT_THAT(problem.poses[i].camera_from_map, RigidNear(truth.poses[i].camera_from_map, 1e-4));
  }
}
INSTANTIATE_TEST_SUITE_P(Sizes, LargeBundleTest, testing::Values(3, 10, 130));

TEST(LargeBundleCasesTest, EndsWhereCeresEnds) {
  for (const bool robust : {false, true}) {
    BundleProblem problem = Disturbed(MakeProblem(12, 2, 300, 0.3, 3), 4), same = problem;
    BundleOptions options = Thorough();
    options.robust = robust;
    options.loss_width = 1;
    const BundleSummary ours = AdjustLargeBundle(&problem, options, nullptr),
                        theirs = AdjustBundle(&same, options, nullptr);
    ASSERT_TRUE(ours.converged_or_stopped);
    EXPECT_NEAR(ours.initial_cost, theirs.initial_cost, 1e-9 * theirs.initial_cost);
    EXPECT_NEAR(ours.final_cost, theirs.final_cost, 1e-3 * theirs.final_cost) << "robust " << robust;
    for (size_t i = 0; i < problem.poses.size(); ++i) {
      EXPECT_THAT(problem.poses[i].camera_from_map, RigidNear(same.poses[i].camera_from_map, 2e-3));
    }
  }
}

TEST(LargeBundleCasesTest, TheLossHoldsAgainstOutliers) {
  const BundleProblem truth = MakeProblem(8, 2, 200, 0.3, 5);
  BundleProblem problem = Disturbed(truth, 6);
  Random random(7);
  for (size_t i = 0; i < problem.measurements.size(); i += 20)
    problem.measurements[i].pixel_px = RandomPixel(&random, TestCamera());
  ASSERT_TRUE(AdjustLargeBundle(&problem, Thorough(), nullptr).converged_or_stopped);
  for (size_t i = 0; i < truth.poses.size(); ++i) {
    EXPECT_LT((problem.poses[i].camera_from_map.translation - truth.poses[i].camera_from_map.translation).norm(), 0.03);
  }
}

TEST(LargeBundleCasesTest, FewStepsComeNearerTheOptimumOfANarrowLossThanCeres) {
  // Errors as wide as the loss: its curvature is far less than the weights say. The start is near, as a window's is
  // that was optimised with the keyframe before.
  BundleProblem start = MakeProblem(12, 2, 300, 0.4, 24);
  Random random(25);
  for (BundleProblem::Pose& pose : start.poses) {
    if (!pose.fixed) pose.camera_from_map = RandomRigid(&random, 0.001, 0.003) * pose.camera_from_map;
  }
  BundleOptions few;
  few.max_iterations = 6;
  few.function_tolerance = 0;
  BundleProblem ours = start, theirs = start, optimum = start;
  const double our_cost = AdjustLargeBundle(&ours, few, nullptr).final_cost,
               their_cost = AdjustBundle(&theirs, few, nullptr).final_cost,
               least_cost = AdjustLargeBundle(&optimum, Thorough(), nullptr).final_cost;
  EXPECT_GE(our_cost, least_cost);
  EXPECT_LT(our_cost - least_cost, 0.5 * (their_cost - least_cost)) << our_cost << ", " << their_cost;
}

TEST(LargeBundleCasesTest, FixedPosesStayBitForBit) {
  const BundleProblem before = Disturbed(MakeProblem(6, 3, 100, 1, 8), 9);
  BundleProblem problem = before;
  ASSERT_TRUE(AdjustLargeBundle(&problem, {}, nullptr).converged_or_stopped);
  for (size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(problem.poses[i].camera_from_map.translation, before.poses[i].camera_from_map.translation);
    EXPECT_EQ(problem.poses[i].camera_from_map.rotation.coeffs(), before.poses[i].camera_from_map.rotation.coeffs());
  }
}

TEST(LargeBundleCasesTest, OnlyPointsAreFree) {
  BundleProblem problem = Disturbed(MakeProblem(4, 4, 50, 0, 10), 11);
  ASSERT_TRUE(AdjustLargeBundle(&problem, Thorough(), nullptr).converged_or_stopped);
  for (const BundleProblem::Measurement& m : problem.measurements) EXPECT_LT(NormalizedSquaredError(problem, m), 1e-6);
}

TEST(LargeBundleCasesTest, UnobservedPosesAndPointsStay) {
  BundleProblem problem = Disturbed(MakeProblem(5, 2, 60, 0.5, 12), 13);
  problem.points_in_map.emplace_back(1, 2, 3);
  problem.poses.push_back({Rigid3d(Eigen::Quaterniond::Identity(), {4, 5, 6}), TestCamera(), false});
  ASSERT_TRUE(AdjustLargeBundle(&problem, {}, nullptr).converged_or_stopped);
  EXPECT_EQ(problem.points_in_map.back(), Eigen::Vector3d(1, 2, 3));
  EXPECT_THAT(problem.poses.back().camera_from_map,
              RigidNear(Rigid3d(Eigen::Quaterniond::Identity(), {4, 5, 6}), 1e-12));
}

TEST(LargeBundleCasesTest, PointsBehindACameraDoNotSpoilTheRest) {
  const BundleProblem truth = MakeProblem(5, 2, 100, 0, 14);
  BundleProblem problem = Disturbed(truth, 15);
  problem.points_in_map.emplace_back(0, 0, -5);
  const auto behind = static_cast<uint32_t>(problem.points_in_map.size() - 1);
  for (uint32_t i = 0; i < 3; ++i) problem.measurements.push_back({i, behind, {300, 200}, 1});
  ASSERT_TRUE(AdjustLargeBundle(&problem, Thorough(), nullptr).converged_or_stopped);
  for (size_t i = 0; i < truth.poses.size(); ++i) {
    EXPECT_THAT(problem.poses[i].camera_from_map, RigidNear(truth.poses[i].camera_from_map, 1e-4));
  }
}

TEST(LargeBundleCasesTest, StopsWhenToldTo) {
  BundleProblem problem = Disturbed(MakeProblem(6, 2, 100, 1, 16), 17);
  const std::atomic<bool> stop{true};
  const BundleSummary summary = AdjustLargeBundle(&problem, Thorough(), &stop);
  EXPECT_TRUE(summary.interrupted);
  EXPECT_LE(summary.iterations, 1);
}

TEST(LargeBundleCasesTest, SameProblemSameResult) {
  const BundleProblem start = Disturbed(MakeProblem(6, 2, 100, 1, 20), 21);
  BundleProblem one = start, two = start;
  (void)AdjustLargeBundle(&one, {}, nullptr);
  (void)AdjustLargeBundle(&two, {}, nullptr);
  EXPECT_EQ(one.points_in_map, two.points_in_map);
}

TEST(LargeBundleCasesTest, UnusableProblemsAreRefused) {
  BundleProblem problem = MakeProblem(4, 2, 30, 1, 22);
  problem.points_in_map[7].z() = std::numeric_limits<double>::infinity();
  EXPECT_FALSE(AdjustLargeBundle(&problem, {}, nullptr).converged_or_stopped);
  problem = MakeProblem(3, 0, 30, 1, 23);
  EXPECT_THROW((void)AdjustLargeBundle(&problem, {}, nullptr), CheckFailure);
}

}  // namespace
}  // namespace portolan
