#include "geometry/two_view.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <functional>

#include "geometry/geometry_test_utils.h"
#include "geometry/triangulation.h"

namespace portolan {
namespace {

using testing::HasSubstr;

constexpr double kSigma = 0.7;  // pixels
constexpr double kDegree = M_PI / 180;

/// Draws a point of the scene in the first camera's frame.
using Scene = std::function<Eigen::Vector3d(Random*, const PinholeCamera&)>;

Eigen::Vector3d General(Random* random, const PinholeCamera& camera) {
  return RandomPointInView(random, camera, 5, 40);
}

Scene Plane(const Eigen::Vector3d& normal, double distance) {
  return [=](Random* random, const PinholeCamera& camera) {
    const Eigen::Vector3d ray = camera.Unproject(RandomPixel(random, camera));
    return Eigen::Vector3d(ray * distance / normal.normalized().dot(ray));
  };
}

/// A street canyon: ground 1.6 below the camera, walls 8 to either side, 6 to 60 ahead.
Eigen::Vector3d Street(Random* random, const PinholeCamera& camera) {
  Eigen::Vector3d point = RandomPointInView(random, camera, 6, 60);
  if (point.y() > 1.6) point *= 1.6 / point.y();
  if (std::abs(point.x()) > 8) point *= 8 / std::abs(point.x());
  return point;
}

/// A wide image like KITTI's.
PinholeCamera WideCamera() {
  return PinholeCamera{700, 700, 620, 190, 1240, 376};
}

PixelMatches Observe(const Scene& scene, const Rigid3d& second_from_first, int n, double outliers, uint64_t seed) {
  const PinholeCamera camera = WideCamera();
  Random random(seed);
  PixelMatches matches;
  while (matches.first_px.size() < static_cast<size_t>(n)) {
    const Eigen::Vector3d in_first = scene(&random, camera);
    const Eigen::Vector3d in_second = second_from_first * in_first;
    if (in_first.z() < 0.5 || in_first.z() > 500 || in_second.z() < 0.5 || !camera.Contains(camera.Project(in_second)))
      continue;
    const bool outlier = random.Uniform() < outliers;
    const Eigen::Vector2d second_px = outlier ? RandomPixel(&random, camera) : camera.Project(in_second);
    matches.first_px.push_back(camera.Project(in_first) + RandomNoise(&random, kSigma));
    matches.second_px.push_back(second_px + RandomNoise(&random, kSigma));
  }
  return matches;
}

double DirectionError(const Eigen::Vector3d& actual, const Eigen::Vector3d& expected) {
  return std::atan2(actual.cross(expected).norm(), actual.dot(expected));
}

int CountTrue(const std::vector<bool>& flags) {
  return static_cast<int>(std::count(flags.begin(), flags.end(), true));
}

const Rigid3d kSideways(ExpSO3({0.01, 0.05, 0.02}), {-1, 0.1, 0.1});
const Rigid3d kForward(ExpSO3({0.002, 0.01, 0}), {0, 0, -2});

TEST(EstimateFundamentalTest, InliersMeetTheConstraintDespiteOutliers) {
  const PixelMatches matches = Observe(General, kSideways, 1000, 0.3, 1);
  const auto model = EstimateFundamental(matches, {});
  ASSERT_TRUE(model.ok());
  EXPECT_NEAR(model->second_from_first.determinant(), 0, 1e-12);
  EXPECT_GT(CountTrue(model->inliers), 620);
  const Eigen::Matrix3d truth = FundamentalFromMotion(kSideways, WideCamera(), WideCamera());
  for (size_t i = 0; i < matches.first_px.size(); ++i) {
    if (!model->inliers[i]) continue;
    const Eigen::Vector3d line = truth * matches.first_px[i].homogeneous();
    EXPECT_LT(std::abs(line.dot(matches.second_px[i].homogeneous())) / line.head<2>().norm(),
              5.0);  // an outlier is 100 px away
  }
}

TEST(EstimateHomographyTest, MapsAPlaneDespiteOutliers) {
  const Scene plane = Plane({0.3, 0.2, 1}, 10);
  const auto model = EstimateHomography(Observe(plane, kSideways, 1000, 0.3, 2), {});
  ASSERT_TRUE(model.ok());
  EXPECT_GT(CountTrue(model->inliers), 620);
  Random random(3);
  for (int i = 0; i < 50; ++i) {
    const Eigen::Vector3d point = plane(&random, WideCamera());
    const Eigen::Vector2d mapped = (model->second_from_first * WideCamera().Project(point).homogeneous()).hnormalized();
    EXPECT_THAT(mapped, VectorNear(WideCamera().Project(kSideways * point), 1.0));
  }
}

TEST(TwoViewModelsTest, TheSceneDecidesTheScore) {
  const PixelMatches planar = Observe(Plane({0, 0, 1}, 10), kSideways, 500, 0, 4);
  const PixelMatches general = Observe(General, kSideways, 500, 0, 5);
  const auto ratio = [](const PixelMatches& matches) {
    const double h = EstimateHomography(matches, {})->score, f = EstimateFundamental(matches, {})->score;
    return h / (h + f);
  };
  EXPECT_GT(ratio(planar), 0.4);
  EXPECT_LT(ratio(general), 0.3);
}

TEST(TwoViewModelsTest, SameSeedSameModel) {
  const PixelMatches matches = Observe(General, kSideways, 300, 0.3, 6);
  EXPECT_EQ(EstimateFundamental(matches, {})->second_from_first, EstimateFundamental(matches, {})->second_from_first);
  EXPECT_EQ(EstimateHomography(matches, {})->inliers, EstimateHomography(matches, {})->inliers);
}

TEST(TwoViewModelsTest, TooFewOrNonFiniteMatchesAreRefused) {
  PixelMatches matches = Observe(General, kSideways, 7, 0, 7);
  EXPECT_THAT(EstimateFundamental(matches, {}).error().message, HasSubstr("at least 8 matches, got 7"));
  matches = Observe(General, kSideways, 3, 0, 7);
  EXPECT_THAT(EstimateHomography(matches, {}).error().message, HasSubstr("at least 4 matches, got 3"));
  matches = Observe(General, kSideways, 60, 0, 7);
  matches.second_px[5].x() = std::nan("");
  EXPECT_THAT(ReconstructTwoViews(matches, WideCamera(), WideCamera(), {}).error().message, HasSubstr("match 5"));
}

TEST(TwoViewModelsTest, EightMatchesSuffice) {
  TwoViewOptions options;
  const PixelMatches matches = Observe(General, kSideways, 8, 0, 8);
  const auto model = EstimateFundamental(matches, options);
  ASSERT_TRUE(model.ok());
  EXPECT_EQ(CountTrue(model->inliers), 8);
}

TEST(TwoViewModelsTest, EqualMatchesDoNotCrash) {
  PixelMatches matches;
  matches.first_px.assign(100, Eigen::Vector2d(5, 5));
  matches.second_px.assign(100, Eigen::Vector2d(5, 5));
  const auto result = ReconstructTwoViews(matches, WideCamera(), WideCamera(), {});
  EXPECT_FALSE(result.ok());
}

TEST(DecomposeTest, EssentialHoldsTheMotionAndItsThreeTwins) {
  Random random(9);
  for (int i = 0; i < 20; ++i) {
    const Rigid3d motion = RandomRigid(&random);
    const Eigen::Matrix3d essential = Skew(motion.translation) * motion.rotation.toRotationMatrix();
    const std::vector<Rigid3d> motions = DecomposeEssential((i % 2 == 0 ? 1 : -3) * essential);
    ASSERT_EQ(motions.size(), 4u);
    const Rigid3d expected(motion.rotation, motion.translation.normalized());
    EXPECT_THAT(motions, testing::Contains(RigidNear(expected, 1e-6)));
    for (const Rigid3d& candidate : motions) {
      const Eigen::Matrix3d again = Skew(candidate.translation) * candidate.rotation.toRotationMatrix();
      EXPECT_NEAR(std::abs((again.array() * essential.array()).sum()), again.norm() * essential.norm(),
                  1e-9);  // equal up to scale
    }
  }
}

TEST(DecomposeTest, HomographyHoldsTheMotionWhateverItsSign) {
  const PinholeCamera camera = WideCamera();
  const Eigen::Vector3d normal = Eigen::Vector3d(0.3, 0.2, 1).normalized();
  const Eigen::Matrix3d euclidean = kSideways.rotation.toRotationMatrix() +
                                    kSideways.translation * normal.transpose() / 10;  // x2 ~ (R + t n^T / d) x1
  const Eigen::Matrix3d homography = camera.K() * euclidean * camera.K().inverse();
  const Rigid3d expected(kSideways.rotation, kSideways.translation.normalized());
  for (const double scale : {1.0, -0.2, 50.0}) {
    std::vector<Rigid3d> motions;
    for (const PlanarMotion& motion : DecomposeHomography(scale * homography, camera)) {
      motions.push_back(motion.second_from_first);
      if (motion.second_from_first.translation.dot(expected.translation) > 1 - 1e-9) {
        EXPECT_THAT(motion.normal_in_first, VectorNear(normal, 1e-5));
      }
    }
    EXPECT_THAT(motions, testing::Contains(RigidNear(expected, 1e-5)));
  }
}

struct Case {
  const char* name;
  Scene scene;
  Rigid3d second_from_first;
  double outliers;
  double max_direction_error_deg;
};

class ReconstructTest : public testing::TestWithParam<Case> {};

TEST_P(ReconstructTest, FindsTheMotionAndThePoints) {
  const Case& c = GetParam();
  for (const uint64_t seed : {11, 12, 13}) {
    const PixelMatches matches = Observe(c.scene, c.second_from_first, 800, c.outliers, seed);
    const auto result = ReconstructTwoViews(matches, WideCamera(), WideCamera(), {});
    ASSERT_TRUE(result.ok()) << result.error().message;
    EXPECT_LT(result->second_from_first.rotation.angularDistance(c.second_from_first.rotation), 0.4 * kDegree);
    EXPECT_LT(DirectionError(result->second_from_first.translation, c.second_from_first.translation),
              c.max_direction_error_deg * kDegree);
    EXPECT_NEAR(result->second_from_first.translation.norm(), 1, 1e-9);
    EXPECT_GT(CountTrue(result->valid), 300);
    for (size_t i = 0; i < matches.first_px.size(); ++i) {
      if (!result->valid[i]) continue;
      const Eigen::Vector3d& point = result->points_in_first[i];
      ASSERT_GT(point.z(), 0);
      EXPECT_LT((WideCamera().Project(point) - matches.first_px[i]).norm(), 3.0);
      EXPECT_LT((WideCamera().Project(result->second_from_first * point) - matches.second_px[i]).norm(), 3.0);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Scenes, ReconstructTest,
                         testing::Values(Case{"GeneralSideways", General, kSideways, 0, 2},
                                         Case{"GeneralOutliers", General, kSideways, 0.3, 3},
                                         Case{"Forward", General, kForward, 0, 1},
                                         Case{"ForwardOutliers", General, kForward, 0.3, 2},
                                         Case{"Street", Street, kForward, 0.1, 1},
                                         Case{"Wall", Plane({0, 0, 1}, 10), kSideways, 0, 5},
                                         Case{"WallOutliers", Plane({0, 0, 1}, 10), kSideways, 0.3, 5},
                                         Case{"TiltedWall", Plane({0.5, 0.2, 1}, 10), kSideways, 0.1, 5}),
                         [](const auto& test) { return test.param.name; });

TEST(ReconstructTwoViewsTest, DifferentCamerasWork) {
  PinholeCamera second_camera = WideCamera();
  second_camera.fx = second_camera.fy = 500;
  PixelMatches matches = Observe(General, kSideways, 500, 0, 21);
  for (Eigen::Vector2d& pixel : matches.second_px) pixel = second_camera.Project(WideCamera().Unproject(pixel));
  const auto result = ReconstructTwoViews(matches, WideCamera(), second_camera, {});
  ASSERT_TRUE(result.ok()) << result.error().message;
  EXPECT_LT(DirectionError(result->second_from_first.translation, kSideways.translation), 3 * kDegree);
}

TEST(ReconstructTwoViewsTest, SameSeedSameResult) {
  const PixelMatches matches = Observe(Street, kForward, 500, 0.3, 22);
  const auto one = ReconstructTwoViews(matches, WideCamera(), WideCamera(), {});
  const auto two = ReconstructTwoViews(matches, WideCamera(), WideCamera(), {});
  ASSERT_TRUE(one.ok() && two.ok());
  EXPECT_EQ(one->points_in_first, two->points_in_first);
}

TEST(ReconstructTwoViewsTest, PureRotationIsRefused) {
  const Rigid3d rotation(kSideways.rotation, Eigen::Vector3d::Zero());
  for (const double outliers : {0.0, 0.3}) {
    const auto result =
        ReconstructTwoViews(Observe(General, rotation, 800, outliers, 23), WideCamera(), WideCamera(), {});
    ASSERT_FALSE(result.ok());
    EXPECT_THAT(result.error().message, HasSubstr("parallax"));
  }
}

TEST(ReconstructTwoViewsTest, LowParallaxIsRefused) {
  const Rigid3d tiny(kSideways.rotation, {0.03, 0, 0});
  const auto result = ReconstructTwoViews(Observe(General, tiny, 800, 0, 24), WideCamera(), WideCamera(), {});
  ASSERT_FALSE(result.ok());
  EXPECT_THAT(result.error().message, HasSubstr("too little parallax"));
}

TEST(ReconstructTwoViewsTest, TwoSolutionsOfAPlaneAreRefused) {
  // Towards a tilted wall: both of a homography's solutions have all points in front of both cameras.
  const Rigid3d towards(ExpSO3({0.01, 0.02, 0.02}), {0, 0, -2});
  const auto result =
      ReconstructTwoViews(Observe(Plane({0.5, 0.2, 1}, 10), towards, 800, 0, 25), WideCamera(), WideCamera(), {});
  ASSERT_FALSE(result.ok());
  EXPECT_THAT(result.error().message, HasSubstr("ambiguous"));
}

/// Turned further by some degrees, as parallax turns what the images tell.
Eigen::Quaterniond ImageRotation(const Rigid3d& second_from_first, double off_deg) {
  return (ExpSO3(off_deg * kDegree * Eigen::Vector3d(0.6, 0.8, 0)) * second_from_first.rotation).normalized();
}

/// Towards and along a tilted wall: what one pair leaves open, pairs in several directions tell.
TEST(ReconstructTwoViewsTest, AWallsTrueMotionIsToldByPairsOfOneFirstView) {
  PlaneWitness witness;
  const Scene wall = Plane({0.5, 0.2, 1}, 10);
  Rigid3d motion;
  Result<TwoViewReconstruction> result = Error{"none"};
  int pairs = 0;
  for (; pairs < 8 && !result.ok(); ++pairs) {
    motion = Rigid3d(ExpSO3({0.01, 0.02 + 0.01 * pairs, 0.02}), {-0.4 * pairs, 0.05 * pairs, -2});
    result = ReconstructTwoViews(Observe(wall, motion, 400, 0.1, 40 + pairs), WideCamera(), WideCamera(), {},
                                 ImageRotation(motion, 5), &witness);
  }
  EXPECT_GT(pairs, 2) << "two say nothing";
  ASSERT_TRUE(result.ok()) << result.error().message;
  EXPECT_LT(result->second_from_first.rotation.angularDistance(motion.rotation), 0.5 * kDegree);
  EXPECT_LT(DirectionError(result->second_from_first.translation, motion.translation), 2 * kDegree);
}

TEST(ReconstructTwoViewsTest, TheImagesRotationLeadsToTheMotionThatRansacMisses) {
  TwoViewOptions options;
  options.ransac_iterations = 1;  // with this seed not a clean sample
  const PixelMatches matches = Observe(General, kSideways, 150, 0.3, 28);
  EXPECT_FALSE(ReconstructTwoViews(matches, WideCamera(), WideCamera(), options).ok());
  const auto result = ReconstructTwoViews(matches, WideCamera(), WideCamera(), options, ImageRotation(kSideways, 5));
  ASSERT_TRUE(result.ok()) << result.error().message;
  EXPECT_LT(result->second_from_first.rotation.angularDistance(kSideways.rotation), 0.5 * kDegree);
  EXPECT_LT(DirectionError(result->second_from_first.translation, kSideways.translation), 4 * kDegree);
}

TEST(ReconstructTwoViewsTest, AMotionThatTurnsOtherwiseThanTheImagesIsRefused) {
  const PixelMatches matches = Observe(General, kSideways, 800, 0.1, 29);
  ASSERT_TRUE(ReconstructTwoViews(matches, WideCamera(), WideCamera(), {}, ImageRotation(kSideways, 20)).ok());
  const auto result = ReconstructTwoViews(matches, WideCamera(), WideCamera(), {}, ImageRotation(kSideways, 40));
  EXPECT_FALSE(result.ok());
}

/// Sideways past a wall by half of its distance: all of the images moves as if the camera turned.
TEST(ReconstructTwoViewsTest, TheImagesMayTurnOtherwiseByTheParallax) {
  const Rigid3d past_wall(ExpSO3({0.02, 0.25, 0.01}), {-5, 0.3, 0.2});
  const PixelMatches matches = Observe(Plane({0.1, 0.1, 1}, 9), past_wall, 600, 0.05, 31);
  const auto by_images = (ExpSO3({0, -0.55, 0}) * past_wall.rotation).normalized();
  const auto result = ReconstructTwoViews(matches, WideCamera(), WideCamera(), {}, by_images);
  ASSERT_TRUE(result.ok()) << result.error().message;
  EXPECT_LT(result->second_from_first.rotation.angularDistance(past_wall.rotation), 0.5 * kDegree);
  EXPECT_LT(DirectionError(result->second_from_first.translation, past_wall.translation), 2 * kDegree);
}

TEST(ReconstructTwoViewsTest, ADirectionThatTheMatchesLeaveOpenIsRefused) {
  TwoViewOptions options;
  options.max_direction_sigma_deg = 0.3;
  const auto reconstruct = [&](int n) {
    return ReconstructTwoViews(Observe(General, kSideways, n, 0, 30), WideCamera(), WideCamera(), options);
  };
  ASSERT_FALSE(reconstruct(70).ok());
  EXPECT_THAT(reconstruct(70).error().message, HasSubstr("direction of translation is known to"));
  EXPECT_TRUE(reconstruct(1500).ok());  // it shrinks with the root of their number
}

TEST(ReconstructTwoViewsTest, RandomMatchesAreRefused) {
  const auto result = ReconstructTwoViews(Observe(General, kSideways, 400, 1.0, 26), WideCamera(), WideCamera(), {});
  ASSERT_FALSE(result.ok());
  EXPECT_THAT(result.error().message, HasSubstr("agree"));
}

TEST(ReconstructTwoViewsTest, TooFewPointsAreRefused) {
  const auto result = ReconstructTwoViews(Observe(General, kSideways, 40, 0, 27), WideCamera(), WideCamera(), {});
  ASSERT_FALSE(result.ok());
  EXPECT_THAT(result.error().message, HasSubstr("need 50"));
}

}  // namespace
}  // namespace portolan
