#include "optimization/point_optimization.h"

#include <gtest/gtest.h>

#include <vector>

#include "geometry/geometry_test_utils.h"

namespace portolan {
namespace {

/// A point seen by cameras side by side.
class PointOptimizationTest : public testing::Test {
 protected:
  void See(int count, double noise, uint64_t seed) {
    Random random(seed);
    views_.reserve(static_cast<size_t>(count));
    for (int k = 0; k < count; ++k) {
      const Rigid3d pose(ExpSO3(RandomVector(&random, 0.02)), {-0.3 * k, 0, 0});
      views_.emplace_back(pose, TestCamera());
      sightings_.push_back({&views_.back(), TestCamera().Project(pose * truth_) + RandomNoise(&random, noise), 1.0});
    }
  }
  const Eigen::Vector3d truth_{0.5, 0.2, 4.0};
  std::vector<PointView> views_;
  std::vector<PointSighting> sightings_;
};

TEST_F(PointOptimizationTest, ExactSightingsLeadToTheTruth) {
  See(5, 0, 1);
  PointOptimizationOptions options;
  options.iterations = 50;
  EXPECT_THAT(OptimizePoint(sightings_, truth_ + Eigen::Vector3d(0.05, -0.05, 0.2), options), VectorNear(truth_, 1e-4));
}

TEST_F(PointOptimizationTest, NeverGetsWorse) {
  for (uint64_t seed = 1; seed < 50; ++seed) {
    views_.clear();
    sightings_.clear();
    See(4, 1.0, seed);
    Random random(seed);
    const Eigen::Vector3d initial = truth_ + RandomVector(&random, 2.0);  // some of them behind the cameras
    const Eigen::Vector3d optimized = OptimizePoint(sightings_, initial);
    EXPECT_LE(PointLoss(sightings_, optimized, kReprojectionLossWidth),
              PointLoss(sightings_, initial, kReprojectionLossWidth));
  }
}

TEST_F(PointOptimizationTest, NoiseLeavesWhatItShould) {
  See(8, 0.3, 3);
  // 0.3 px over 8 views at depth 4 and f = 500: 0.001 across, depth from a base of 2 some three times that.
  EXPECT_THAT(OptimizePoint(sightings_, truth_ + Eigen::Vector3d(0.01, 0, 0.05)), VectorNear(truth_, 0.02));
}

TEST_F(PointOptimizationTest, AGrossErrorIsLetGo) {
  See(8, 0, 4);
  sightings_[3].pixel_px.x() += 40;
  PointOptimizationOptions options;
  options.iterations = 50;
  EXPECT_THAT(OptimizePoint(sightings_, truth_ + Eigen::Vector3d(0.01, 0, 0.05), options), VectorNear(truth_, 1e-3));
}

TEST_F(PointOptimizationTest, OneSightingTellsNothing) {
  See(1, 0, 5);
  const Eigen::Vector3d initial = truth_ + Eigen::Vector3d(1, 0, 0);
  EXPECT_EQ(OptimizePoint(sightings_, initial), initial);
}

}  // namespace
}  // namespace portolan
