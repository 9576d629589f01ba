#include "place_recognition/neighbourhood.h"

#include <gtest/gtest.h>

#include <set>

#include "testing/map_builder.h"

namespace portolan {
namespace {

TEST(NeighbourhoodTest, HoldsTheKeyFrameFirstAndEachLandmarkOnce) {
  const SyntheticScene scene = MakeSyntheticScene(SyntheticSceneOptions());
  const Map map = BuildMap(scene), other_map = map;
  NeighbourhoodOptions options;
  options.neighbours = 4;
  options.second_neighbours = 0;
  const KeyFrameId id = scene.views[5].data->id;
  const Neighbourhood side(map, id, options), other(other_map, id, options);
  EXPECT_EQ(side.keyframe().data->id, id);
  EXPECT_EQ(side.keyframes().size(), 5u);
  const std::vector<const MapPoint*> landmarks = side.Landmarks(other);  // of another map: all
  const std::set<const MapPoint*> once(landmarks.begin(), landmarks.end());
  EXPECT_EQ(once.size(), landmarks.size());
  const std::vector<const MapPoint*> by_feature = side.LandmarksByFeature(side.keyframe(), other);
  for (size_t i = 0; i < by_feature.size(); ++i) {
    ASSERT_EQ(by_feature[i] != nullptr, side.keyframe().landmarks[i].IsValid());
    if (by_feature[i] == nullptr) continue;
    EXPECT_EQ(by_feature[i]->id, side.keyframe().landmarks[i]);
    EXPECT_EQ(once.count(by_feature[i]), 1u);
  }
  options.second_neighbours = 9;  // of a scene all of whose keyframes see each other
  options.most = 7;
  EXPECT_EQ(Neighbourhood(map, id, options).keyframes().size(), 7u);
  options.neighbours = 0;
  EXPECT_EQ(Neighbourhood(map, id, options).keyframes().size(), 1u);
}

TEST(NeighbourhoodTest, WhatTheOtherSideOfOneMapSeesDoesNotCount) {
  const SyntheticScene scene = MakeSyntheticScene(SyntheticSceneOptions());
  Map map = BuildMap(scene);
  NeighbourhoodOptions options;
  options.neighbours = 0;
  const KeyFrameId first = scene.views[0].data->id, last = scene.views[9].data->id;
  int seen_by_last = 0;
  for (const MapPointId id : map.SortedPointIds()) {  // the last keyframe keeps every third landmark
    if (id.sequence() % 3 != 0)
      map.RemoveObservation(id, last);
    else
      seen_by_last += map.point(id).FindObservation(last) != nullptr ? 1 : 0;
  }
  ASSERT_GT(seen_by_last, 50);
  const Neighbourhood side(map, first, options), other(map, last, options);
  for (const MapPoint* landmark : side.Landmarks(other)) {
    EXPECT_FALSE(other.Sees(*landmark));
    EXPECT_TRUE(side.Sees(*landmark));
  }
  const std::vector<const MapPoint*> by_feature = side.LandmarksByFeature(side.keyframe(), other);
  for (size_t i = 0; i < by_feature.size(); ++i) {
    const MapPointId id = side.keyframe().landmarks[i];
    if (!id.IsValid()) continue;
    EXPECT_EQ(by_feature[i] == nullptr, other.Sees(map.point(id)));
  }
}

}  // namespace
}  // namespace portolan
