#include "geometry/epipolar_refinement.h"

#include <gtest/gtest.h>

#include <cmath>

#include "geometry/geometry_test_utils.h"

namespace portolan {
namespace {

constexpr double kSigma = 1.0 / 500;  // one pixel on the plane z = 1
constexpr double kMaxDistance = 2 * kSigma;

struct Matches {
  std::vector<Eigen::Vector2d> first_xy, second_xy;
};

Matches RandomMatches(Random* random, const Rigid3d& second_from_first, int n, double sigma, double outliers) {
  const PinholeCamera camera = TestCamera();
  Matches matches;
  for (int i = 0; i < n; ++i) {
    const Eigen::Vector3d point = RandomPointInView(random, camera, 3, 12);
    const bool outlier = random->Uniform() < outliers;
    const Eigen::Vector2d second = outlier ? camera.Normalize(RandomPixel(random, camera))
                                           : Eigen::Vector2d((second_from_first * point).hnormalized());
    matches.first_xy.push_back(point.hnormalized() + RandomNoise(random, sigma));
    matches.second_xy.push_back(second + RandomNoise(random, sigma));
  }
  return matches;
}

Rigid3d TrueMotion() {
  return Rigid3d(ExpSO3({0.02, -0.05, 0.03}), Eigen::Vector3d(1, 0.2, -0.4).normalized());
}

TEST(TangentBasisTest, IsOrthonormalAndPerpendicular) {
  Random random(1);
  for (int i = 0; i < 20; ++i) {
    const Eigen::Vector3d unit = RandomVector(&random).normalized();
    const Eigen::Matrix<double, 3, 2> basis = TangentBasis(unit);
    EXPECT_TRUE((basis.transpose() * basis).isIdentity(1e-12));
    EXPECT_LT((basis.transpose() * unit).norm(), 1e-12);
  }
}

TEST(SampsonDistanceTest, GradientIsTheNumericOne) {
  constexpr double kStep = 1e-6;
  Random random(2);
  for (int trial = 0; trial < 20; ++trial) {
    const Rigid3d motion(RandomRigid(&random).rotation, RandomVector(&random).normalized());
    const Eigen::Vector2d first = RandomNoise(&random, 0.5), second = RandomNoise(&random, 0.5);
    Eigen::Matrix<double, 5, 1> gradient;
    (void)SampsonDistance(motion, first, second, &gradient);
    for (int k = 0; k < 5; ++k) {
      const Eigen::Matrix<double, 5, 1> step = kStep * Eigen::Matrix<double, 5, 1>::Unit(k);
      const double numeric = (SampsonDistance(MoveOnEssentialManifold(motion, step), first, second, nullptr) -
                              SampsonDistance(MoveOnEssentialManifold(motion, -step), first, second, nullptr)) /
                             (2 * kStep);
      EXPECT_NEAR(gradient[k], numeric, 1e-6 * (1 + std::abs(numeric))) << "parameter " << k;
    }
  }
}

TEST(SampsonDistanceTest, HasTheStandardDeviationOfTheFeatures) {
  Random random(3);
  const Matches matches = RandomMatches(&random, TrueMotion(), 4000, kSigma, 0);
  double sum = 0;
  for (size_t i = 0; i < matches.first_xy.size(); ++i) {
    sum += std::pow(SampsonDistance(TrueMotion(), matches.first_xy[i], matches.second_xy[i], nullptr), 2);
  }
  EXPECT_NEAR(std::sqrt(sum / 4000), kSigma, 0.05 * kSigma);  // 5 %: over four standard errors
}

TEST(RefineMotionTest, ExactMatchesLeadToTheTruth) {
  Random random(4);
  const Matches matches = RandomMatches(&random, TrueMotion(), 200, 0, 0);
  const Rigid3d start = MoveOnEssentialManifold(
      TrueMotion(), (Eigen::Matrix<double, 5, 1>() << 0.02, -0.01, 3e-3, 2e-3, -2e-3).finished());
  EXPECT_THAT(RefineMotion(start, matches.first_xy, matches.second_xy, 1.0), RigidNear(TrueMotion(), 1e-5));
}

TEST(RefineMotionTest, OutliersDoNotPull) {
  Random random(5);
  const Matches matches = RandomMatches(&random, TrueMotion(), 1000, kSigma / 2, 0.3);
  const Rigid3d start = MoveOnEssentialManifold(
      TrueMotion(), (Eigen::Matrix<double, 5, 1>() << 0.02, 0.01, 1e-3, -1e-3, 1e-3).finished());
  EXPECT_THAT(RefineMotion(start, matches.first_xy, matches.second_xy, kMaxDistance), RigidNear(TrueMotion(), 0.01));
}

TEST(RefineMotionTest, WithoutMatchesTheMotionStays) {
  EXPECT_THAT(RefineMotion(TrueMotion(), {}, {}, kMaxDistance), RigidNear(TrueMotion(), 1e-12));
}

}  // namespace
}  // namespace portolan
