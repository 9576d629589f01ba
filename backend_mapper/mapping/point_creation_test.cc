#include "mapping/point_creation.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "mapping/mapping_test_scene.h"

namespace portolan {
namespace {

class PointCreation : public ::testing::Test {
 protected:
  /// Two views of a scene, every second point of which is a landmark already.
  void MakeScene(const TestSceneOptions& options, const Eigen::Vector3d& second_centre) {
    scene_ = std::make_unique<TestScene>(options);
    views_ = {scene_->See(CameraAt({0, 0, 0})), scene_->See(CameraAt(second_centre, {0.01, 0.05, 0.02}))};
    map_ = std::make_unique<Map>(BuildTrueMap(*scene_, views_, 2));
  }
  std::vector<MapPointId> Create() {
    auto created = CreatePoints(map_.get(), views_[0].data->id, views_[1].data->id, options_, &mint_);
    map_->RefreshDerived();
    return created;
  }
  /// Distance from the true place, none for a point of two different true points.
  std::optional<double> Error(MapPointId id) const {
    const MapPoint& point = map_->point(id);
    const int first = TruePointOf(point, {views_[0]}), second = TruePointOf(point, {views_[1]});
    if (first < 0 || first != second) return std::nullopt;
    return (point.position_in_map.cast<double>() - scene_->points_in_map()[static_cast<size_t>(first)]).norm();
  }

  PointCreationOptions options_;
  IdMinter<MapPointId> mint_{1, 2};
  std::unique_ptr<TestScene> scene_;
  std::vector<TestView> views_;
  std::unique_ptr<Map> map_;
};

TEST_F(PointCreation, TriangulatesExactFeaturesExactly) {
  MakeScene({}, {0.8, 0.1, 0});
  const size_t common = TrueMatches(views_[0], views_[1]).size(), before = map_->points().size();
  const auto created = Create();
  EXPECT_GT(created.size(), (common - before) * 9 / 10);
  for (const MapPointId id : created) {
    const auto error = Error(id);
    ASSERT_TRUE(error.has_value()) << "a match of different points";
    EXPECT_LT(*error, 1e-3);  // pixels are floats
  }
  EXPECT_THAT(ValidateMap(*map_), ::testing::IsEmpty());
}

TEST_F(PointCreation, KeepsToTheTruthAmongClutterAndNoise) {
  TestSceneOptions scene;
  scene.pixel_sigma = 0.3;
  scene.flipped_bits = 20;
  scene.clutter = 500;
  MakeScene(scene, {0.8, 0.1, 0});
  const size_t expected = TrueMatches(views_[0], views_[1]).size() - map_->points().size();
  int wrong = 0;
  const auto created = Create();
  for (const MapPointId id : created) {
    const auto error = Error(id);
    // Depth noise: z^2 / (b f) * sigma_px with z = 10, b = 0.8, f = 500, sigma = 0.3 * 2 (octave) * sqrt 2: 0.2; five
    // sigma.
    if (!error || *error > 1.0) ++wrong;
  }
  EXPECT_GT(created.size(), expected * 7 / 10);
  EXPECT_LE(wrong, static_cast<int>(created.size()) / 50);
}

TEST_F(PointCreation, FindsPointsOnTheWayAhead) {
  MakeScene({}, {0.05, 0.02, 1.0});
  EXPECT_GT(Create().size(), 30u);
  for (const auto& [id, point] : map_->points()) EXPECT_LT(Error(id).value_or(1e9), 1e-2);
}

TEST_F(PointCreation, LeavesShortBaselinesAndEmptyKeyFramesAlone) {
  MakeScene({}, {0.01, 0, 0});
  EXPECT_TRUE(Create().empty());
  MakeScene({}, {0.8, 0, 0});
  for (const MapPointId id : map_->SortedPointIds()) map_->RemovePoint(id);
  EXPECT_TRUE(Create().empty());
}

TEST_F(PointCreation, RefusesWithoutParallax) {
  options_.min_baseline = 0;
  MakeScene({}, {0.01, 0, 0});
  EXPECT_TRUE(Create().empty());
}

TEST_F(PointCreation, RefusesInconsistentScales) {
  options_.max_scale_ratio = 1.5;  // true octaves are off by rounding, 1.2, at most
  MakeScene({}, {0.8, 0.1, 0});
  const KeyFrameView first(map_->keyframe(views_[0].data->id));
  KeyFrameData changed = *views_[1].data;
  for (uint8_t& octave : changed.features.octaves) octave = octave < 4 ? 7 : 0;  // four octaves off: a factor of 2.07
  KeyFrame altered = map_->keyframe(views_[1].data->id);
  altered.data = MakeKeyFrameData(changed, nullptr);
  const KeyFrameView second(altered), unaltered(map_->keyframe(views_[1].data->id));
  const MatchTriangulator with_change(first, second, options_), without(first, unaltered, options_);
  int accepted = 0;
  for (const auto& [i, j] : TrueMatches(views_[0], views_[1])) {
    EXPECT_FALSE(with_change.Triangulate(i, j).has_value());
    accepted += without.Triangulate(i, j).has_value() ? 1 : 0;
  }
  EXPECT_GT(accepted, 100);
}

TEST_F(PointCreation, RefusesMatchesOffTheEpipolarLine) {
  MakeScene({}, {0.8, 0.1, 0});
  const KeyFrameView first(map_->keyframe(views_[0].data->id)), second(map_->keyframe(views_[1].data->id));
  const MatchTriangulator triangulator(first, second, options_);
  const auto matches = TrueMatches(views_[0], views_[1]);
  int refused = 0;
  for (size_t k = 0; k + 1 < matches.size(); ++k) {
    refused += triangulator.Triangulate(matches[k].first, matches[k + 1].second).has_value() ? 0 : 1;
  }
  EXPECT_GT(refused, static_cast<int>(matches.size()) * 9 / 10);
}

}  // namespace
}  // namespace portolan
