#include "mapping/point_fusion.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "mapping/mapping_test_scene.h"

namespace portolan {
namespace {

/// The same scene as a map in which the last two views know their own copies of the points: as after a revisit that
/// tracking missed.
Map BuildDoubledMap(const TestScene& scene, const std::vector<TestView>& views, int shared_every) {
  Map map = BuildTrueMap(scene, views);
  const KeyFrameId second_last = views[views.size() - 2].data->id, last = views.back().data->id;
  uint32_t next = 1;
  for (const MapPointId id : map.SortedPointIds()) {
    if (id.value % static_cast<uint64_t>(shared_every) == 0) continue;
    const Observation* in_second_last = map.point(id).FindObservation(second_last);
    const Observation* in_last = map.point(id).FindObservation(last);
    if (in_second_last == nullptr || in_last == nullptr || map.point(id).observations.size() < 4) continue;
    const uint32_t second_last_feature = in_second_last->feature, last_feature = in_last->feature;
    map.RemoveObservation(id, second_last);
    map.RemoveObservation(id, last);
    const MapPointId copy(9, 9, next++);
    map.AddPoint(copy, map.point(id).position_in_map);
    map.AddObservation(copy, second_last, second_last_feature);
    map.AddObservation(copy, last, last_feature);
  }
  map.RefreshDerived();
  return map;
}

class Fusion : public ::testing::Test {
 protected:
  void SetUp() override {
    TestSceneOptions options;
    options.flipped_bits = 8;
    scene_ = std::make_unique<TestScene>(options);
    views_ = SeeAlongPath(scene_.get(), 6, 0.3);
  }
  FusionOptions options_;
  std::unique_ptr<TestScene> scene_;
  std::vector<TestView> views_;
};

TEST_F(Fusion, MergesDoubles) {
  Map map = BuildDoubledMap(*scene_, views_, 5);
  const size_t truth = BuildTrueMap(*scene_, views_).points().size(), doubled = map.points().size();
  ASSERT_GT(doubled, truth + 50);
  const FusionResult result = FuseWithNeighbours(&map, views_.back().data->id, options_);
  EXPECT_EQ(map.points().size() + result.merges.size(), doubled);
  EXPECT_GT(result.merges.size(), (doubled - truth) * 9 / 10);
  for (const auto& [from, into] : result.merges) {
    EXPECT_EQ(from.robot(), 9) << "the original has more observations and stays";
    EXPECT_EQ(map.FindPoint(from), nullptr);
    const MapPoint* point = map.FindPoint(into);
    ASSERT_NE(point, nullptr);
    const int truth_point = TruePointOf(*point, views_);
    for (const TestView& view : views_) {
      const Observation* o = point->FindObservation(view.data->id);
      if (o == nullptr) continue;
      EXPECT_EQ(view.points[o->feature], truth_point);
    }
  }
  EXPECT_THAT(ValidateMap(map), ::testing::IsEmpty());
}

TEST_F(Fusion, FindsMissingObservations) {
  Map map = BuildTrueMap(*scene_, views_);
  const KeyFrameId last = views_.back().data->id;
  int removed = 0;
  for (const MapPointId id : map.SortedPointIds()) {
    if (map.point(id).observations.size() < 4 || map.point(id).FindObservation(last) == nullptr || id.value % 3 == 0)
      continue;
    map.RemoveObservation(id, last);
    ++removed;
  }
  ASSERT_GT(removed, 50);
  const FusionResult result = FuseWithNeighbours(&map, last, options_);
  EXPECT_TRUE(result.merges.empty());
  EXPECT_GT(static_cast<int>(result.observations.size()), removed * 9 / 10);
  EXPECT_THAT(ValidateMap(map), ::testing::IsEmpty());
}

TEST_F(Fusion, LeavesACompleteMapAlone) {
  Map map = BuildTrueMap(*scene_, views_);
  map.TakeDelta();
  const FusionResult result = FuseWithNeighbours(&map, views_.back().data->id, options_);
  EXPECT_TRUE(result.merges.empty());
  EXPECT_TRUE(result.observations.empty());
  EXPECT_TRUE(map.TakeDelta().IsEmpty());
}

TEST_F(Fusion, PassesOverWhatIsGone) {
  Map map = BuildTrueMap(*scene_, views_);
  FusionResult result;
  FuseIntoKeyFrame(&map, views_[0].data->id, {MapPointId(7, 7, 7)}, options_, &result);
  EXPECT_TRUE(result.observations.empty());
  EXPECT_TRUE(result.merges.empty());
}

}  // namespace
}  // namespace portolan
