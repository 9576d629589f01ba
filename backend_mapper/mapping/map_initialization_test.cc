#include "mapping/map_initialization.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>

#include "geometry/sim3_alignment.h"
#include "mapping/mapping_test_scene.h"

namespace portolan {
namespace {

using ::testing::HasSubstr;

/// Largest distance of the structure's points from the truth after Sim3 alignment, world units.
double WorstAlignedError(const InitialStructure& structure, const TestView& first, const TestScene& scene) {
  std::vector<Eigen::Vector3d> estimated, truth;
  for (const auto& point : structure.points) {
    estimated.push_back(point.position_in_first);
    truth.push_back(scene.points_in_map()[static_cast<size_t>(first.points[point.first_feature])]);
  }
  const auto alignment = AlignPoints(estimated, truth);
  EXPECT_TRUE(alignment.ok());
  double worst = 0;
  for (size_t i = 0; i < truth.size(); ++i) worst = std::max(worst, (*alignment * estimated[i] - truth[i]).norm());
  return worst;
}

double MedianDepth(const InitialStructure& structure) {
  std::vector<double> depths;
  for (const auto& point : structure.points) depths.push_back(point.position_in_first.z());
  std::sort(depths.begin(), depths.end());
  return depths[depths.size() / 2];
}

class Initialization : public ::testing::TestWithParam<bool> {};
INSTANTIATE_TEST_SUITE_P(RoomAndPlane, Initialization, ::testing::Bool());

TEST_P(Initialization, RecoversStructureAndMotionUpToScale) {
  TestSceneOptions options;
  options.planar = GetParam();
  TestScene scene(options);
  const TestView first = scene.See(CameraAt({0, 0, 0}));
  const TestView second = scene.See(CameraAt({1.0, 0.1, 0.3}, {0.02, 0.08, 0.01}));
  const auto matches = TrueMatches(first, second);
  const auto structure = ReconstructInitialStructure(*first.data, *second.data, matches, {});
  ASSERT_TRUE(structure.ok()) << structure.error().message;
  EXPECT_GT(structure->points.size(), matches.size() * 9 / 10);
  EXPECT_LT(WorstAlignedError(*structure, first, scene), 2e-3);  // pixels are floats, 3e-5 px
  EXPECT_NEAR(MedianDepth(*structure), 1.0, 1e-9);
  const Rigid3d truth = second.camera_from_map * first.camera_from_map.Inverse();
  EXPECT_LT(LogSO3(truth.rotation.conjugate() * structure->second_from_first.rotation).norm(), 1e-4);
  EXPECT_LT((structure->second_from_first.translation.normalized() - truth.translation.normalized()).norm(), 1e-3);
}

TEST(Initialization, AKnownMotionIsEnoughWhereTwoViewsAreAmbiguous) {
  TestSceneOptions options;
  options.pixel_sigma = 0.5;
  TestScene scene(options);
  const TestView first = scene.See(CameraAt({0, 0, 0}));
  const TestView second = scene.See(CameraAt({0.02, 0, 0.2}));  // nearly straight ahead
  const auto matches = TrueMatches(first, second);
  Rigid3d known = second.camera_from_map * first.camera_from_map.Inverse();
  known.translation *= 7;  // units of another map
  InitializationOptions lenient;
  lenient.two_view.min_parallax_deg = 0.4;
  const auto structure = ReconstructInitialStructure(*first.data, *second.data, matches, lenient, known);
  ASSERT_TRUE(structure.ok()) << structure.error().message;
  EXPECT_GE(structure->points.size(), 50u);
  EXPECT_LT((structure->second_from_first.translation.normalized() - known.translation.normalized()).norm(), 0.1);
  // Without it the views are refused, and so is a wrong motion.
  EXPECT_FALSE(ReconstructInitialStructure(*first.data, *second.data, matches, {}).ok());
  const Rigid3d wrong(ExpSO3({0, 0.5, 0}), {0, 1, 0});
  EXPECT_FALSE(ReconstructInitialStructure(*first.data, *second.data, matches, lenient, wrong).ok());
}

TEST(Initialization, ToleratesNoiseAndWrongMatches) {
  TestSceneOptions options;
  options.pixel_sigma = 0.5;
  TestScene scene(options);
  const TestView first = scene.See(CameraAt({0, 0, 0}));
  const TestView second = scene.See(CameraAt({1.2, 0.1, 0.2}, {0.02, 0.1, 0.01}));
  auto matches = TrueMatches(first, second);
  // Every fifth match is wrong: its second features are rotated among them.
  for (size_t k = 0; k + 5 < matches.size(); k += 5) std::swap(matches[k].second, matches[k + 5].second);
  const auto structure = ReconstructInitialStructure(*first.data, *second.data, matches, {});
  ASSERT_TRUE(structure.ok()) << structure.error().message;
  EXPECT_GT(structure->points.size(), matches.size() / 2);
  const Rigid3d truth = second.camera_from_map * first.camera_from_map.Inverse();
  // 0.5 px * scale up to 3.6 at f = 500 is 4e-3 rad a feature; over more than 100 of them well below that.
  EXPECT_LT(LogSO3(truth.rotation.conjugate() * structure->second_from_first.rotation).norm(), 4e-3);
  EXPECT_LT((structure->second_from_first.translation.normalized() - truth.translation.normalized()).norm(), 0.05);
}

TEST(Initialization, RefusesPureRotation) {
  TestSceneOptions options;
  options.pixel_sigma = 0.3;
  TestScene scene(options);
  const TestView first = scene.See(CameraAt({0, 0, 0}));
  const TestView second = scene.See(CameraAt({0, 0, 0}, {0.02, 0.1, 0.05}));
  EXPECT_FALSE(ReconstructInitialStructure(*first.data, *second.data, TrueMatches(first, second), {}).ok());
}

TEST(Initialization, RefusesTooFewMatches) {
  TestScene scene;
  const TestView first = scene.See(CameraAt({0, 0, 0}));
  const TestView second = scene.See(CameraAt({1, 0, 0}));
  auto matches = TrueMatches(first, second);
  matches.resize(20);
  EXPECT_FALSE(ReconstructInitialStructure(*first.data, *second.data, matches, {}).ok());
  EXPECT_FALSE(ReconstructInitialStructure(*first.data, *second.data, {}, {}).ok());
}

TEST(Initialization, RefusesMatchesThatCannotBe) {
  TestScene scene;
  const TestView first = scene.See(CameraAt({0, 0, 0}));
  const TestView second = scene.See(CameraAt({1, 0, 0}));
  auto matches = TrueMatches(first, second);
  auto out_of_range = matches;
  out_of_range[7].second = 100000;
  const auto unknown = ReconstructInitialStructure(*first.data, *second.data, out_of_range, {});
  ASSERT_FALSE(unknown.ok());
  EXPECT_THAT(unknown.error().message, HasSubstr("100000"));
  matches[1].first = matches[0].first;
  const auto twice = ReconstructInitialStructure(*first.data, *second.data, matches, {});
  ASSERT_FALSE(twice.ok());
  EXPECT_THAT(twice.error().message, HasSubstr("twice"));
}

}  // namespace
}  // namespace portolan
