#include "place_recognition/landmark_search.h"

#include <gtest/gtest.h>

#include "place_recognition/neighbourhood.h"
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
    EXPECT_GT(result.Share(), 0.95);
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
  EXPECT_EQ(result.Share(), 0);
}

TEST(NeighbourhoodTest, HoldsTheKeyFrameFirstAndEachLandmarkOnce) {
  const SyntheticScene scene = MakeSyntheticScene(SyntheticSceneOptions());
  const Map map = BuildMap(scene);
  NeighbourhoodOptions options;
  options.neighbours = 4;
  options.second_neighbours = 0;
  const KeyFrameId id = scene.views[5].data->id;
  const Neighbourhood side(map, id, options);
  EXPECT_EQ(side.keyframe().data->id, id);
  EXPECT_EQ(side.keyframes.size(), 5u);
  EXPECT_EQ(side.landmarks.size(), side.ids.size());
  for (const MapPointId landmark : map.keyframe(id).landmarks) EXPECT_TRUE(!landmark.IsValid() || side.Sees(landmark));

  options.second_neighbours = 9;  // with a scene all of whose keyframes see each other
  options.most = 7;
  EXPECT_EQ(Neighbourhood(map, id, options).keyframes.size(), 7u);
  options.neighbours = 0;
  EXPECT_EQ(Neighbourhood(map, id, options).keyframes.size(), 1u);
}

TEST(NeighbourhoodTest, RemoveLeavesOutWhatTheOtherSideSees) {
  const SyntheticScene scene = MakeSyntheticScene(SyntheticSceneOptions());
  const Map map = BuildMap(scene);
  Neighbourhood side(map, scene.views[5].data->id, {});
  const size_t before = side.landmarks.size();
  const MapPointId removed = side.landmarks.front()->id;
  side.Remove({removed});
  EXPECT_EQ(side.landmarks.size(), before - 1);
  EXPECT_FALSE(side.Sees(removed));
  EXPECT_NE(side.landmarks.front()->id, removed);
}

}  // namespace
}  // namespace portolan
