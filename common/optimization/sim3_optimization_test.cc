#include "optimization/sim3_optimization.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "geometry/geometry_test_utils.h"

namespace portolan {
namespace {

const PinholeCamera kCameraA = TestCamera(), kCameraB{420, 415, 300, 210, 620, 440};

struct Scene {
  Sim3d b_from_a;
  std::vector<Sim3Match> matches;
  std::vector<bool> is_outlier;
};

/// Where a camera beside its side's frame sees the point. @param noise sigmas.
SideView See(const PinholeCamera& camera, const Rigid3d& camera_from_side, const Eigen::Vector3d& point_in_side,
             double noise, Random* random) {
  SideView view{&camera, camera_from_side, camera.Project(camera_from_side * point_in_side), 1};
  view.sigma_px = std::pow(1.2, static_cast<double>(random->Below(8)));
  view.pixel_px += RandomNoise(random, noise * view.sigma_px);
  return view;
}

/// Landmarks in front of both frames, each seen from its frame and from another camera a sixth of its depth aside.
/// @param noise of the pixels, sigmas. @param outliers share of matches whose pixel in b is drawn at random.
Scene RandomScene(uint64_t seed, int n, double noise, double outliers, double scale = 2.5) {
  Random random(seed);
  Scene scene;
  const Rigid3d turn = RandomRigid(&random, 0.1, 0.3);
  scene.b_from_a = Sim3d(scale, turn.rotation, scale * turn.translation);
  for (int i = 0; i < n; ++i) {
    Sim3Match match;
    match.point_in_a = RandomPointInView(&random, kCameraA, 3, 12);
    match.point_in_b = scene.b_from_a * match.point_in_a;
    const Rigid3d beside_a(Eigen::Quaterniond::Identity(), {1, 0, 0}), beside_b(ExpSO3({0, 0.1, 0}), {-scale, 0, 0});
    match.views_in_a.push_back(See(kCameraA, Rigid3d(), match.point_in_a, noise, &random));
    match.views_in_a.push_back(See(kCameraA, beside_a, match.point_in_a, noise, &random));
    match.views_in_b.push_back(See(kCameraB, Rigid3d(), match.point_in_b, noise, &random));
    match.views_in_b.push_back(See(kCameraB, beside_b, match.point_in_b, noise, &random));
    scene.is_outlier.push_back(random.Uniform() < outliers);
    if (scene.is_outlier.back()) match.views_in_b[0].pixel_px = RandomPixel(&random, kCameraB);
    scene.matches.push_back(match);
  }
  return scene;
}

Sim3d Displaced(const Sim3d& b_from_a, double size) {
  Vector7d twist;
  twist << 3, -3, 3, 1, 1, -1, 2;
  return ExpSim3(size * twist) * b_from_a;
}

Sim3OptimizationResult Optimize(const Scene& scene, const Sim3d& start, const Sim3OptimizationOptions& options = {}) {
  return OptimizeSim3(scene.matches, start, options);
}

/// Distance of two similarities: the twist between them.
Vector7d Difference(const Sim3d& found, const Sim3d& truth) {
  return LogSim3(found * truth.Inverse());
}

using Linearization = bool (*)(const SideView&, const Eigen::Vector3d&, const Sim3d&, Eigen::Vector2d*, Sim3Jacobian*);

void ExpectNumericJacobian(Linearization linearize, const SideView& view, const Eigen::Vector3d& point,
                           const Sim3d& b_from_a) {
  constexpr double kStep = 1e-6;
  Eigen::Vector2d residual, plus, minus;
  Sim3Jacobian jacobian, unused;
  ASSERT_TRUE(linearize(view, point, b_from_a, &residual, &jacobian));
  for (int i = 0; i < 7; ++i) {
    const Vector7d step = kStep * Vector7d::Unit(i);
    ASSERT_TRUE(linearize(view, point, ExpSim3(step) * b_from_a, &plus, &unused));
    ASSERT_TRUE(linearize(view, point, ExpSim3(-step) * b_from_a, &minus, &unused));
    const Eigen::Vector2d numeric = (plus - minus) / (2 * kStep);
    EXPECT_LT((numeric - jacobian.col(i)).norm(), 1e-5 * (1 + numeric.norm())) << "parameter " << i;
  }
}

TEST(LinearizeSim3Test, JacobiansAreTheNumericOnes) {
  const Scene scene = RandomScene(1, 30, 2, 0);
  for (const Sim3Match& match : scene.matches) {
    for (const SideView& view : match.views_in_b)
      ExpectNumericJacobian(LinearizeInB, view, match.point_in_a, scene.b_from_a);
    for (const SideView& view : match.views_in_a)
      ExpectNumericJacobian(LinearizeInA, view, match.point_in_b, scene.b_from_a);
  }
}

TEST(Chi2OfTest, IsTheWorseOfTheFirstViews) {
  Scene scene = RandomScene(1, 30, 0, 0);
  for (Sim3Match& match : scene.matches) {
    EXPECT_NEAR(Chi2Of(match, scene.b_from_a), 0, 1e-12);
    match.views_in_a[0].pixel_px.x() += 2 * match.views_in_a[0].sigma_px;
    match.views_in_b[0].pixel_px.y() += 3 * match.views_in_b[0].sigma_px;
    match.views_in_b[1].pixel_px.y() += 9 * match.views_in_b[1].sigma_px;
    EXPECT_NEAR(Chi2Of(match, scene.b_from_a), 9, 1e-9);
    match.views_in_a[0].pixel_px.x() += 2 * match.views_in_a[0].sigma_px;
    EXPECT_NEAR(Chi2Of(match, scene.b_from_a), 16, 1e-9);
    match.point_in_a = -match.point_in_a;
    EXPECT_EQ(Chi2Of(match, scene.b_from_a), std::numeric_limits<double>::infinity());
    match.views_in_b.clear();
    EXPECT_EQ(Chi2Of(match, scene.b_from_a), std::numeric_limits<double>::infinity());
  }
}

TEST(OptimizeSim3Test, ExactMatchesLeadToTheSimilarityFromAfar) {
  for (const uint64_t seed : {1, 2, 3}) {
    for (const double scale : {0.2, 1.0, 5.0}) {
      const Scene scene = RandomScene(seed, 60, 0, 0, scale);
      const auto result = Optimize(scene, Displaced(scene.b_from_a, 0.05));
      EXPECT_LT(Difference(result.b_from_a, scene.b_from_a).norm(), 1e-6);
      EXPECT_EQ(result.num_inliers, 60);
    }
  }
}

TEST(OptimizeSim3Test, PixelNoiseLeavesErrorsOfItsSize) {
  // Sigmas of 2 pixels of 450: a view tells a direction to 4.5 mrad and, from a sixth of the depth aside, the depth to
  // 3 %. 4 views of each of 200 landmarks tell the rotation to 0.2 mrad, 2 of them the scale to 0.15 %; the rest of the
  // unknowns blurs that by a factor of a few.
  double sum = 0;
  constexpr int kTrials = 20;
  for (uint64_t seed = 1; seed <= kTrials; ++seed) {
    const Scene scene = RandomScene(seed, 200, 1, 0);
    const Vector7d error = Difference(Optimize(scene, Displaced(scene.b_from_a, 0.02)).b_from_a, scene.b_from_a);
    EXPECT_LT(error.segment<3>(3).norm(), 0.003);
    EXPECT_LT(std::abs(error[6]), 0.01);
    sum += std::abs(error[6]);
  }
  EXPECT_LT(sum / kTrials, 0.003);
}

TEST(OptimizeSim3Test, ScaleShowsInOtherViewsAlone) {
  // Both frames at one point: their own pixels fit any scale, those of the cameras beside them only the right one.
  Scene scene = RandomScene(3, 100, 0, 0);
  for (Sim3Match& match : scene.matches) {
    const Eigen::Vector3d in_b = scene.b_from_a.scale * match.point_in_a;
    for (SideView& view : match.views_in_b) view.pixel_px = kCameraB.Project(view.camera_from_side * in_b);
    match.point_in_b = in_b;
  }
  const Sim3d truth(scene.b_from_a.scale, Eigen::Quaterniond::Identity(), Eigen::Vector3d::Zero());
  const Sim3d start(1.05 * truth.scale, truth.rotation, truth.translation);
  const auto all = OptimizeSim3(scene.matches, start);
  EXPECT_NEAR(all.b_from_a.scale / truth.scale, 1, 1e-6);
  for (Sim3Match& match : scene.matches) {
    match.views_in_a.pop_back();
    match.views_in_b.pop_back();
  }
  const auto own = OptimizeSim3(scene.matches, start);
  EXPECT_NEAR(own.b_from_a.scale / truth.scale, 1.05, 1e-6);
  EXPECT_EQ(own.num_inliers, 100);
}

TEST(OptimizeSim3Test, OutliersAreToldAndDoNotPull) {
  for (const uint64_t seed : {4, 5, 6}) {
    const Scene scene = RandomScene(seed, 200, 0.3, 0.4);
    const auto result = Optimize(scene, Displaced(scene.b_from_a, 0.01));
    EXPECT_LT(Difference(result.b_from_a, scene.b_from_a).norm(), 0.02);
    int wrong = 0;
    for (size_t i = 0; i < scene.matches.size(); ++i) wrong += result.inliers[i] == scene.is_outlier[i] ? 1 : 0;
    EXPECT_LE(wrong, 4);  // pixels drawn near the right one by chance
    EXPECT_EQ(result.num_inliers, std::count(result.inliers.begin(), result.inliers.end(), true));
  }
}

TEST(OptimizeSim3Test, AFixedScaleStays) {
  const Scene scene = RandomScene(7, 100, 0, 0, 1.0);
  Sim3OptimizationOptions options;
  options.fix_scale = true;
  Vector7d twist;
  twist << 0.1, -0.1, 0.1, 0.02, 0.02, -0.02, 0;
  const auto result = Optimize(scene, ExpSim3(twist) * scene.b_from_a, options);
  EXPECT_EQ(result.b_from_a.scale, 1);
  EXPECT_LT(Difference(result.b_from_a, scene.b_from_a).norm(), 1e-6);

  const auto kept = Optimize(scene, Displaced(scene.b_from_a, 0.05), options);
  EXPECT_NEAR(kept.b_from_a.scale, std::exp(0.1), 1e-12);
}

TEST(OptimizeSim3Test, FindsTheInverseWithTheSidesExchanged) {
  const Scene scene = RandomScene(8, 100, 0.5, 0);
  std::vector<Sim3Match> exchanged;
  for (const Sim3Match& m : scene.matches)
    exchanged.push_back({m.point_in_b, m.point_in_a, m.views_in_b, m.views_in_a});
  const Sim3d b_from_a = Optimize(scene, scene.b_from_a).b_from_a;
  const Sim3d a_from_b = OptimizeSim3(exchanged, scene.b_from_a.Inverse()).b_from_a;
  EXPECT_LT(Difference(a_from_b.Inverse(), b_from_a).norm(), 1e-3);
}

TEST(OptimizeSim3Test, WithoutUsableMatchesNothingMoves) {
  Scene scene = RandomScene(9, 10, 0, 0);
  const Sim3d start = Displaced(scene.b_from_a, 0.01);
  for (size_t i = 2; i < scene.matches.size(); ++i) {
    if (i % 2 == 0) scene.matches[i].point_in_a.z() = -5;  // behind camera b
    if (i % 2 == 1) scene.matches[i].point_in_b.x() = std::numeric_limits<double>::quiet_NaN();
  }
  for (const auto& result : {Optimize(scene, start), Optimize(Scene{}, start)}) {
    EXPECT_EQ(result.num_inliers, 0);
    EXPECT_EQ(result.b_from_a.scale, start.scale);
    EXPECT_EQ(result.b_from_a.translation, start.translation);
  }
}

}  // namespace
}  // namespace portolan
