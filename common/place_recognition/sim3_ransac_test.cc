#include "place_recognition/sim3_ransac.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "geometry/geometry_test_utils.h"

namespace portolan {
namespace {

using ::testing::HasSubstr;

struct Scene {
  Sim3d b_from_a;
  std::vector<Sim3Match> matches;
};

const PinholeCamera kCamera = TestCamera();

SideView See(const Rigid3d& camera_from_side, const Eigen::Vector3d& point_in_side) {
  return {&kCamera, camera_from_side, kCamera.Project(camera_from_side * point_in_side), 1};
}

/// Landmarks mapped twice. @param wrong share of matches between different landmarks. @param depth_sigma relative error
/// of the landmarks' depth on both sides, as monocular maps have it.
Scene RandomScene(uint64_t seed, int n, double wrong, double depth_sigma = 0) {
  Random random(seed);
  Scene scene;
  const Rigid3d turn = RandomRigid(&random, 0.1, 0.3);
  scene.b_from_a = Sim3d(1.7, turn.rotation, turn.translation);
  const Rigid3d own, beside(Eigen::Quaterniond::Identity(), {0.5, 0, 0});
  for (int i = 0; i < n; ++i) {
    Sim3Match match;
    const Eigen::Vector3d in_a = RandomPointInView(&random, kCamera, 3, 12);
    const Eigen::Vector3d other = RandomPointInView(&random, kCamera, 3, 12);
    const Eigen::Vector3d in_b = scene.b_from_a * (random.Uniform() < wrong ? other : in_a);
    match.views_in_a = {See(own, in_a), See(beside, in_a)};
    match.views_in_b = {See(own, in_b), See(beside, in_b)};
    match.point_in_a = in_a * (1 + depth_sigma * random.Gaussian());
    match.point_in_b = in_b * (1 + depth_sigma * random.Gaussian());
    scene.matches.push_back(match);
  }
  return scene;
}

Result<Sim3Estimate> Estimate(const Scene& scene, const Sim3RansacOptions& options = {}) {
  return EstimateSim3(scene.matches, options);
}

TEST(EstimateSim3Test, FindsItAmongWrongMatches) {
  for (const uint64_t seed : {1, 2, 3, 4, 5}) {
    for (const double wrong : {0.0, 0.3, 0.5, 0.7}) {
      const Scene scene = RandomScene(seed, 120, wrong);
      const auto found = Estimate(scene);
      ASSERT_TRUE(found.ok()) << found.error().message;
      EXPECT_LT(LogSim3(found->b_from_a * scene.b_from_a.Inverse()).norm(), 1e-4) << wrong;
    }
  }
}

TEST(EstimateSim3Test, RefinementMakesUpForUncertainDepths) {
  for (const uint64_t seed : {1, 2, 3}) {
    const Scene scene = RandomScene(seed, 150, 0.4, 0.02);
    const auto found = Estimate(scene);
    ASSERT_TRUE(found.ok()) << found.error().message;
    EXPECT_LT(LogSim3(found->b_from_a * scene.b_from_a.Inverse()).norm(), 0.05);
    EXPECT_GT(found->num_inliers, 60);
  }
}

TEST(EstimateSim3Test, IsTheSameForTheSameSeed) {
  const Scene scene = RandomScene(1, 100, 0.5, 0.02);
  Sim3RansacOptions options;
  options.seed = 7;
  const auto first = Estimate(scene, options), second = Estimate(scene, options);
  ASSERT_TRUE(first.ok() && second.ok());
  EXPECT_EQ(first->b_from_a.translation, second->b_from_a.translation);
  EXPECT_EQ(first->num_inliers, second->num_inliers);
}

TEST(EstimateSim3Test, SaysWhatIsMissing) {
  const auto few = Estimate(RandomScene(1, 10, 0));
  ASSERT_FALSE(few.ok());
  EXPECT_EQ(few.error().message, "RANSAC: 10 matches, expected 12");
  const auto chance = Estimate(RandomScene(1, 100, 1));
  ASSERT_FALSE(chance.ok());
  EXPECT_THAT(chance.error().message, HasSubstr("inliers of 100, expected 12"));
}

TEST(EstimateSim3Test, PointsOnALineAreRefused) {
  Scene scene = RandomScene(1, 50, 0);
  for (size_t i = 0; i < scene.matches.size(); ++i) {
    scene.matches[i].point_in_a = Eigen::Vector3d(0.1, 0.1, 0.2) * static_cast<double>(i + 1);
    scene.matches[i].point_in_b = scene.b_from_a * scene.matches[i].point_in_a;
  }
  const auto found = Estimate(scene);
  ASSERT_FALSE(found.ok());
  EXPECT_EQ(found.error().message, "RANSAC: 0 inliers of 50, expected 12");
}

TEST(EstimateSim3Test, PointsBehindTheCameraAreNoInliers) {
  // The mirror image of each side through its camera projects to the same pixels.
  Scene scene = RandomScene(1, 50, 0);
  for (Sim3Match& match : scene.matches) {
    match.point_in_a = -match.point_in_a;
    match.point_in_b = -match.point_in_b;
  }
  const auto found = Estimate(scene);
  ASSERT_FALSE(found.ok());
  EXPECT_EQ(found.error().message, "RANSAC: 0 inliers of 50, expected 12");
}

}  // namespace
}  // namespace portolan
