#include "tracking/local_map.h"

#include <gmock/gmock.h>

#include <set>

#include "tracking/synthetic_frame.h"

namespace portolan {
namespace {

using ::testing::IsEmpty;

class LocalMapTest : public ::testing::Test {
 protected:
  LocalMapTest() {
    SyntheticSceneOptions options;
    options.num_views = 20;
    options.travel = 12;
    scene_ = MakeSyntheticScene(options);
    map_ = BuildMap(scene_);
    static_cast<void>(map_.TakeDelta());
  }
  std::set<MapPointId> PointsOf(const std::vector<KeyFrameId>& keyframes) const {
    std::set<MapPointId> points;
    for (const KeyFrameId id : keyframes) {
      for (const MapPointId landmark : map_.keyframe(id).landmarks) {
        if (landmark.IsValid()) points.insert(landmark);
      }
    }
    return points;
  }
  static std::set<MapPointId> IdsOf(const LocalMap& local_map) {
    std::set<MapPointId> ids;
    for (const auto& landmark : local_map.landmarks()) ids.insert(landmark.id);
    return ids;
  }

  SyntheticScene scene_;
  Map map_;
};

TEST_F(LocalMapTest, HoldsTheLandmarksOfItsKeyFramesOnce) {
  LocalMap local_map;
  local_map.Update(map_, TrueLandmarks(scene_, 7, map_), 8);
  EXPECT_EQ(IdsOf(local_map), PointsOf(local_map.keyframes()));
  EXPECT_EQ(IdsOf(local_map).size(), local_map.landmarks().size());
  for (const LocalMap::Landmark& landmark : local_map.landmarks()) {
    const MapPoint& point = map_.point(landmark.id);
    EXPECT_EQ(landmark.position_in_map, point.position_in_map.cast<double>());
    EXPECT_EQ(landmark.descriptor, point.descriptor);
    EXPECT_EQ(landmark.max_distance, point.max_distance);
  }
}

TEST_F(LocalMapTest, ReferenceSharesMostLandmarks) {
  // A quarter of its landmarks are lost to all but it and one other, each time another one.
  const KeyFrameId wanted = scene_.views[7].data->id;
  size_t number = 0;
  for (const MapPointId id : map_.SortedPointIds()) {
    if (map_.point(id).FindObservation(wanted) == nullptr || ++number % 4 != 0) continue;
    const std::vector<Observation> observations = map_.point(id).observations;
    for (size_t i = 0; i < observations.size(); ++i) {
      if (observations[i].keyframe != wanted && i != number / 4 % observations.size())
        map_.RemoveObservation(id, observations[i].keyframe);
    }
  }
  LocalMap local_map;
  local_map.Update(map_, map_.keyframe(wanted).landmarks.ByFeature(), 8);
  EXPECT_EQ(local_map.reference(), wanted);
  EXPECT_EQ(local_map.keyframes()[0], wanted);
}

TEST_F(LocalMapTest, NumberOfKeyFramesIsBounded) {
  for (const int most : {2, 5, 9, 100}) {
    LocalMap local_map;
    local_map.Update(map_, TrueLandmarks(scene_, 7, map_), most);
    EXPECT_LE(local_map.keyframes().size(), static_cast<size_t>(most));
    const std::set<KeyFrameId> distinct(local_map.keyframes().begin(), local_map.keyframes().end());
    EXPECT_EQ(distinct.size(), local_map.keyframes().size());
    EXPECT_GE(local_map.keyframes().size(), static_cast<size_t>(std::min(most, 10)) / 2);
  }
}

TEST_F(LocalMapTest, TakesNeighboursThatShareNothingWithTheFrame) {
  // The frame sees one landmark alone; others come in through the pose graph.
  const MapPointId seen = map_.keyframe(scene_.views[4].data->id).landmarks[0].IsValid()
                              ? map_.keyframe(scene_.views[4].data->id).landmarks[0]
                              : map_.SortedPointIds()[0];
  const size_t direct = map_.point(seen).observations.size();
  LocalMap local_map;
  local_map.Update(map_, {seen}, 60);
  EXPECT_GE(local_map.keyframes().size(), direct);
  EXPECT_GT(local_map.landmarks().size(), 50u);
}

TEST_F(LocalMapTest, FollowsAChangedMap) {
  LocalMap local_map;
  const auto landmarks = TrueLandmarks(scene_, 7, map_);
  local_map.Update(map_, landmarks, 8);
  const MapPointId moved = local_map.landmarks()[0].id, removed = local_map.landmarks()[1].id;
  map_.SetPosition(moved, {1, 2, 3});
  map_.RemovePoint(removed);
  static_cast<void>(map_.TakeDelta());
  local_map.Update(map_, landmarks, 8);
  EXPECT_EQ(IdsOf(local_map), PointsOf(local_map.keyframes()));
  EXPECT_EQ(IdsOf(local_map).count(removed), 0u);
  for (const auto& landmark : local_map.landmarks()) {
    if (landmark.id == moved) {
      EXPECT_EQ(landmark.position_in_map, Eigen::Vector3d(1, 2, 3));
    }
  }
}

TEST_F(LocalMapTest, NothingSeenIsEmpty) {
  LocalMap local_map;
  local_map.Update(map_, {MapPointId(), MapPointId(0, 9, 9)}, 10);
  EXPECT_THAT(local_map.keyframes(), IsEmpty());
  EXPECT_THAT(local_map.landmarks(), IsEmpty());
  EXPECT_FALSE(local_map.reference().IsValid());
}

}  // namespace
}  // namespace portolan
