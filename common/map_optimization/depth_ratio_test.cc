#include "map_optimization/depth_ratio.h"

#include <gtest/gtest.h>

#include "testing/map_builder.h"
#include "testing/synthetic_scene.h"

namespace portolan {
namespace {

class DepthRatioTest : public testing::Test {
 protected:
  void SetUp() override {
    scene_ = MakeSyntheticScene(SyntheticSceneOptions());
    old_map_ = BuildMap(scene_);
    MapBuilderOptions options;
    options.map_from_world = Sim3d(0.4, ExpSO3({0.1, 0.2, 0.3}), {1, 2, 3});
    new_map_ = BuildMap(scene_, options);
    for (const auto& [id, point] : new_map_.points()) points_.insert(id);
  }
  SyntheticScene scene_;
  Map old_map_, new_map_;
  std::unordered_set<MapPointId> points_;
};

TEST_F(DepthRatioTest, IsTheOldMapsUnitsInOneOfTheNew) {
  for (const auto& [id, keyframe] : old_map_.keyframes()) {
    EXPECT_NEAR(DepthRatio(old_map_, new_map_, id, points_, 7), 1 / 0.4, 1e-5);
  }
}

TEST_F(DepthRatioTest, AFewWrongOnesDoNotMatter) {
  int wrong = 0;
  for (const MapPointId id : new_map_.SortedPointIds()) {
    if (wrong++ % 4 == 0) new_map_.SetPosition(id, 3 * new_map_.point(id).position_in_map);
  }
  EXPECT_NEAR(DepthRatio(old_map_, new_map_, old_map_.keyframes().begin()->first, points_, 7), 1 / 0.4, 1e-3);
}

TEST_F(DepthRatioTest, WithoutPointsIsWhatTheCallerSays) {
  EXPECT_EQ(DepthRatio(old_map_, new_map_, old_map_.keyframes().begin()->first, {}, 7), 7);
}

}  // namespace
}  // namespace portolan
