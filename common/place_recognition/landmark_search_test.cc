#include "place_recognition/landmark_search.h"

#include <gtest/gtest.h>

#include "testing/map_builder.h"

namespace portolan {
namespace {

std::vector<const MapPoint*> PointsOf(const Map& map) {
  std::vector<const MapPoint*> points;
  for (const MapPointId id : map.SortedPointIds()) points.push_back(&map.point(id));
  return points;
}

TEST(FindLandmarksTest, FindsWhatTheKeyFrameSees) {
  SyntheticSceneOptions options;
  options.num_clutter = 300;
  options.descriptor_flip_ratio = 0.03;
  const SyntheticScene scene = MakeSyntheticScene(options);
  const Map map = BuildMap(scene);
  const std::vector<const MapPoint*> points = PointsOf(map);
  for (const SyntheticView& view : scene.views) {
    const auto result = FindLandmarks(points, view.camera_from_world, *view.data, {});
    EXPECT_GT(result.expected.Share(), 0.95);
    EXPECT_EQ(result.ShareOfCells(0.5), 1);
    EXPECT_GT(result.Spread(*view.data), 0.5);
    for (const FoundLandmark& found : result.found) {
      EXPECT_EQ(points[found.landmark]->id, PointOfLandmark(scene, view.landmark_of_feature[found.feature]));
      EXPECT_LT(found.error_px, 0.01);
    }
  }
}

TEST(FindLandmarksTest, OfTwoLandmarksAtOneFeatureTheCloserDescriptorWins) {
  const SyntheticScene scene = MakeSyntheticScene(SyntheticSceneOptions());
  const Map map = BuildMap(scene);
  MapPoint right = *PointsOf(map).front(), wrong = right;
  for (int bit = 0; bit < 20; ++bit) wrong.descriptor[0] ^= uint64_t{1} << bit;
  const SyntheticView& view = scene.views[4];
  const auto result = FindLandmarks({&wrong, &right}, view.camera_from_world, *view.data, {});
  EXPECT_EQ(result.visible, 2);
  ASSERT_EQ(result.found.size(), 1u);
  EXPECT_EQ(result.found[0].landmark, 1u);
}

TEST(FindLandmarksTest, WhatIsOutOfViewIsNotExpected) {
  const SyntheticScene scene = MakeSyntheticScene(SyntheticSceneOptions());
  const Map map = BuildMap(scene);
  const Rigid3d turned_away = Rigid3d(ExpSO3({0, M_PI, 0}), {0, 0, 0}) * scene.views[0].camera_from_world;
  const auto result = FindLandmarks(PointsOf(map), turned_away, *scene.views[0].data, {});
  EXPECT_EQ(result.visible, 0);
  EXPECT_EQ(result.expected.Share(), 0);
  EXPECT_EQ(result.ShareOfCells(0), 0);
  EXPECT_EQ(result.Spread(*scene.views[0].data), 0);
}

TEST(FindLandmarksTest, CellsTellWhereSomethingIsMissing) {
  // What lies in the left half of the image looks different.
  const SyntheticScene scene = MakeSyntheticScene(SyntheticSceneOptions());
  const Map map = BuildMap(scene);
  const SyntheticView& view = scene.views[4];
  Random random(5);
  std::vector<MapPoint> changed;
  for (const MapPoint* point : PointsOf(map)) {
    changed.push_back(*point);
    const Eigen::Vector3d in_camera = view.camera_from_world * point->position_in_map.cast<double>();
    if (view.data->camera.Project(in_camera).x() < 320) changed.back().descriptor = RandomDescriptor(&random);
  }
  std::vector<const MapPoint*> points;
  for (const MapPoint& point : changed) points.push_back(&point);
  const auto result = FindLandmarks(points, view.camera_from_world, *view.data, {});
  for (size_t cell = 0; cell < result.cells.size(); ++cell) {
    if (cell % LandmarkSearchResult::kColumns < LandmarkSearchResult::kColumns / 2)
      EXPECT_EQ(result.cells[cell].found, 0);
    else
      EXPECT_GE(result.cells[cell].Share(), result.cells[cell].expected > 0 ? 0.7 : 0);
  }
  EXPECT_NEAR(result.ShareOfCells(0.5), 0.5, 0.15);
}

TEST(FindLandmarksTest, OnlyEstablishedLandmarksSeenFromNearbyAreExpected) {
  const SyntheticScene scene = MakeSyntheticScene(SyntheticSceneOptions());
  const Map map = BuildMap(scene);
  const SyntheticView& view = scene.views[4];
  LandmarkSearchOptions options;
  const auto all = FindLandmarks(PointsOf(map), view.camera_from_world, *view.data, options);
  EXPECT_GT(all.expected.expected, 300);
  options.min_observations = 11;  // one more than there are views
  EXPECT_EQ(FindLandmarks(PointsOf(map), view.camera_from_world, *view.data, options).expected.expected, 0);
  options.min_observations = 2;
  options.min_viewing_cosine = 1.1;
  const auto none = FindLandmarks(PointsOf(map), view.camera_from_world, *view.data, options);
  EXPECT_EQ(none.expected.expected, 0);
  EXPECT_EQ(none.found.size(), all.found.size());
}

}  // namespace
}  // namespace portolan
