#include "geometry/absolute_pose.h"

#include <gtest/gtest.h>

#include <cmath>

#include "base/check.h"
#include "geometry/geometry_test_utils.h"

namespace portolan {
namespace {

using testing::HasSubstr;

struct View {
  Rigid3d camera_from_map;
  std::vector<Eigen::Vector3d> landmarks_in_map;
  std::vector<Eigen::Vector2d> pixels_px;
  std::vector<double> sigmas_px;
  std::vector<bool> is_outlier;
};

/// @param flat puts all landmarks on a tilted plane.
View RandomView(uint64_t seed, int n, double noise_px, double outliers, bool flat = false) {
  const PinholeCamera camera = TestCamera();
  Random random(seed);
  View view;
  view.camera_from_map = RandomRigid(&random, 1, 5);
  const Eigen::Vector3d normal = Eigen::Vector3d(0.3, 0.2, 1).normalized();
  for (int i = 0; i < n; ++i) {
    Eigen::Vector3d in_camera = RandomPointInView(&random, camera, 2, 12);
    if (flat) in_camera *= 6 / normal.dot(in_camera);
    view.landmarks_in_map.push_back(view.camera_from_map.Inverse() * in_camera);
    view.is_outlier.push_back(random.Uniform() < outliers);
    view.pixels_px.push_back((view.is_outlier.back() ? RandomPixel(&random, camera) : camera.Project(in_camera)) +
                             RandomNoise(&random, noise_px));
    view.sigmas_px.push_back(1);
  }
  return view;
}

Result<AbsolutePose> Estimate(const View& view, const AbsolutePoseOptions& options = {}) {
  return EstimateAbsolutePose(TestCamera(), view.landmarks_in_map, view.pixels_px, view.sigmas_px, options);
}

class AbsolutePoseTest : public testing::TestWithParam<bool> {};

TEST_P(AbsolutePoseTest, ExactMatchesGiveThePose) {
  for (const uint64_t seed : {1, 2, 3, 4, 5}) {
    const View view = RandomView(seed, 60, 0, 0, GetParam());
    const auto pose = Estimate(view);
    ASSERT_TRUE(pose.ok()) << pose.error().message;
    EXPECT_THAT(pose->camera_from_map, RigidNear(view.camera_from_map, 1e-4));
    EXPECT_EQ(pose->num_inliers, 60);
  }
}

TEST_P(AbsolutePoseTest, NoiseAndOutliersAreTold) {
  for (const uint64_t seed : {1, 2, 3, 4, 5}) {
    const View view = RandomView(seed, 300, 1, 0.4, GetParam());
    const auto pose = Estimate(view);
    ASSERT_TRUE(pose.ok()) << pose.error().message;
    // One pixel is 12 to 24 thousandths at a distance of 6 to 12; averaging over 180 matches wins a factor of ten,
    // which the coupling of rotation and translation takes back.
    EXPECT_THAT(pose->camera_from_map, RigidNear(view.camera_from_map, 0.04));
    int wrong = 0;
    for (size_t i = 0; i < view.is_outlier.size(); ++i) wrong += pose->inliers[i] == view.is_outlier[i] ? 1 : 0;
    EXPECT_LE(wrong, 3);  // an outlier may lie within 4 px of its place by chance
  }
}

INSTANTIATE_TEST_SUITE_P(GeneralAndFlat, AbsolutePoseTest, testing::Bool());

TEST(AbsolutePoseLimitsTest, SigmaWidensTheInlierThreshold) {
  View view = RandomView(6, 40, 0, 0);
  view.pixels_px[0].x() += 10;
  EXPECT_FALSE(Estimate(view)->inliers[0]);
  view.sigmas_px[0] = 3.6;
  EXPECT_TRUE(Estimate(view)->inliers[0]);
}

TEST(AbsolutePoseLimitsTest, FourMatchesSuffice) {
  AbsolutePoseOptions options;
  options.min_inliers = 4;
  const View view = RandomView(7, 4, 0, 0);
  const auto pose = Estimate(view, options);
  ASSERT_TRUE(pose.ok()) << pose.error().message;
  EXPECT_EQ(pose->num_inliers, 4);
}

TEST(AbsolutePoseLimitsTest, SameSeedSamePose) {
  const View view = RandomView(8, 200, 1, 0.5);
  const auto one = Estimate(view), two = Estimate(view);
  ASSERT_TRUE(one.ok() && two.ok());
  EXPECT_EQ(one->camera_from_map.translation, two->camera_from_map.translation);
  EXPECT_EQ(one->inliers, two->inliers);
}

TEST(AbsolutePoseLimitsTest, NoConsensusIsAnError) {
  const auto pose = Estimate(RandomView(9, 60, 1, 1.0));
  ASSERT_FALSE(pose.ok());
  EXPECT_THAT(pose.error().message, HasSubstr("need 12"));
}

TEST(AbsolutePoseLimitsTest, BadInputIsNamed) {
  EXPECT_THAT(Estimate(RandomView(10, 3, 0, 0)).error().message, HasSubstr("at least 4 matches, got 3"));
  View view = RandomView(10, 20, 0, 0);
  view.landmarks_in_map[7].z() = std::nan("");
  EXPECT_THAT(Estimate(view).error().message, HasSubstr("match 7"));
  view.sigmas_px.pop_back();
  EXPECT_THROW((void)Estimate(view), CheckFailure);
}

TEST(AbsolutePoseLimitsTest, OneLandmarkSeenManyTimesGivesNoCrash) {
  View view = RandomView(11, 30, 0, 0);
  std::fill(view.landmarks_in_map.begin(), view.landmarks_in_map.end(), view.landmarks_in_map[0]);
  EXPECT_FALSE(Estimate(view).ok());
}

}  // namespace
}  // namespace portolan
