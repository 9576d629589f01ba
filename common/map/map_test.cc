#include "map/map.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "base/check.h"
#include "map/random_edits.h"

namespace portolan {
namespace {

using ::testing::IsEmpty;

/// Number of points that both keyframes see, counted point by point.
std::map<std::pair<KeyFrameId, KeyFrameId>, int> CountCovisibility(const Map& map) {
  std::map<std::pair<KeyFrameId, KeyFrameId>, int> counts;
  for (const auto& [id, point] : map.points()) {
    for (const Observation& a : point.observations) {
      for (const Observation& b : point.observations) {
        if (a.keyframe != b.keyframe) ++counts[{a.keyframe, b.keyframe}];
      }
    }
  }
  return counts;
}

void ExpectCovisibilityIsExact(const Map& map) {
  const auto counts = CountCovisibility(map);
  for (const auto& [a, keyframe_a] : map.keyframes()) {
    std::vector<std::pair<KeyFrameId, int>> neighbours;
    for (const auto& [b, keyframe_b] : map.keyframes()) {
      const auto found = counts.find({a, b});
      const int expected = found != counts.end() ? found->second : 0;
      ASSERT_EQ(map.Covisibility(a, b), expected) << a << " and " << b;
      if (expected > 0) neighbours.emplace_back(b, expected);
    }
    std::stable_sort(neighbours.begin(), neighbours.end(),
                     [](const auto& x, const auto& y) { return x.second > y.second; });
    ASSERT_EQ(map.CovisibleKeyFrames(a, 1), neighbours);
  }
}

class RandomMapTest : public ::testing::TestWithParam<uint64_t> {};

TEST_P(RandomMapTest, EveryChangeLeavesTheMapValid) {
  Map map(MapId(0, 1, 1), 1);
  RandomEdits edits(GetParam(), &map);
  std::set<int> kinds;
  for (int i = 0; i < 300; ++i) {
    const int kind = edits.Next();
    kinds.insert(kind);
    ASSERT_THAT(ValidateMap(map), IsEmpty()) << "after edit " << i << " of kind " << kind;
    if (i % 10 == 0) ExpectCovisibilityIsExact(map);
  }
  EXPECT_EQ(kinds.size(), static_cast<size_t>(RandomEdits::kNumKinds));
}

TEST_P(RandomMapTest, DerivedFieldsDependOnTheStateAlone) {
  Map map(MapId(0, 1, 1), 1);
  RandomEdits edits(GetParam(), &map);
  for (int i = 0; i < 200; ++i) {
    edits.Next();
    if (i % 7 == 0) map.RefreshDerived();
  }
  map.RefreshDerived();
  Map fresh(map.id(), map.epoch());
  ASSERT_TRUE(fresh.Apply(map.Snapshot(), edits.FindData()).ok());
  ASSERT_GT(map.points().size(), 3u);
  for (const auto& [id, point] : map.points()) {
    const MapPoint& other = fresh.point(id);
    EXPECT_EQ(point.descriptor, other.descriptor) << id;
    EXPECT_EQ(point.mean_viewing_direction, other.mean_viewing_direction) << id;
    EXPECT_EQ(point.min_distance, other.min_distance) << id;
    EXPECT_EQ(point.max_distance, other.max_distance) << id;
  }
}

INSTANTIATE_TEST_SUITE_P(Seeds, RandomMapTest, ::testing::Range<uint64_t>(1, 9));

/// Three keyframes: the first at the origin, the others hang on it, then on the second; looking along z.
class SmallMapTest : public ::testing::Test {
 protected:
  SmallMapTest() {
    Random random(7);
    for (uint32_t i = 0; i < 3; ++i) {
      const KeyFrameId id(0, 1, i + 1);
      ids_.push_back(id);
      map_.AddKeyFrame(RandomEdits::MakeData(id, &random), Rigid3d(Eigen::Quaterniond::Identity(), {-1.0 * i, 0, 0}),
                       i > 0 ? ids_[i - 1] : KeyFrameId());
    }
  }
  MapPointId AddPoint(uint32_t number, const std::vector<std::pair<int, uint32_t>>& seen_by) {
    const MapPointId id(0, 1, number);
    map_.AddPoint(id, {0, 0, 4});
    for (const auto& [keyframe, feature] : seen_by)
      EXPECT_TRUE(map_.AddObservation(id, ids_[static_cast<size_t>(keyframe)], feature));
    return id;
  }

  Map map_{MapId(0, 1, 1), 1};
  std::vector<KeyFrameId> ids_;
};

TEST_F(SmallMapTest, DerivesViewingDirectionAndDistances) {
  // The cameras' centres are (0,0,0) and (1,0,0).
  const MapPointId id = AddPoint(1, {{0, 3}, {1, 5}});
  map_.RefreshDerived();
  const MapPoint& point = map_.point(id);
  const Eigen::Vector3f first = Eigen::Vector3f(0, 0, 4).normalized(), second = Eigen::Vector3f(-1, 0, 4).normalized();
  EXPECT_LT((point.mean_viewing_direction - (first + second).normalized()).norm(), 1e-6f);
  const double first_scale = std::pow(1.2, map_.keyframe(ids_[0]).data->features.octaves[3]);
  const double second_scale = std::pow(1.2, map_.keyframe(ids_[1]).data->features.octaves[5]);
  const double at_level_0[] = {4 * first_scale, std::sqrt(17.0) * second_scale};
  EXPECT_NEAR(point.max_distance, std::max(at_level_0[0], at_level_0[1]), 1e-5);
  EXPECT_NEAR(point.min_distance, std::min(at_level_0[0], at_level_0[1]) / std::pow(1.2, 7), 1e-5);
  EXPECT_EQ(point.descriptor, map_.keyframe(ids_[1]).data->features.descriptors[5]);  // of two the younger
}

TEST_F(SmallMapTest, DerivedFieldsFollowAMovedCamera) {
  const MapPointId id = AddPoint(1, {{0, 3}, {1, 5}});
  map_.RefreshDerived();
  const float before = map_.point(id).max_distance;
  for (const KeyFrameId keyframe : ids_) map_.SetPose(keyframe, Rigid3d(Eigen::Quaterniond::Identity(), {0, 0, 16}));
  map_.RefreshDerived();
  EXPECT_GT(map_.point(id).max_distance, 4 * before);
  EXPECT_LT((map_.point(id).mean_viewing_direction - Eigen::Vector3f::UnitZ()).norm(), 1e-6f);
}

TEST(MapDescriptor, IsTheOneInTheMiddleOfTheOthers) {
  Map map(MapId(0, 1, 1), 1);
  map.AddPoint(MapPointId(0, 1, 1), {0, 0, 4});
  // Bits set: 0, 8, 10, 12, 200. Distances are differences; the middle ones are nearest to most.
  const int bits[] = {0, 8, 10, 12, 200};
  for (uint32_t i = 0; i < 5; ++i) {
    KeyFrameData data;
    data.id = KeyFrameId(0, 1, i + 1);
    data.camera = PinholeCamera{500, 500, 319.5, 239.5, 640, 480};
    data.features.pixels_px = {{100, 100}};
    data.features.octaves = {0};
    data.features.angles_rad = {0};
    data.features.descriptors.resize(1);
    for (int bit = 0; bit < bits[i]; ++bit)
      data.features.descriptors[0][static_cast<size_t>(bit / 64)] |= uint64_t{1} << (bit % 64);
    map.AddKeyFrame(MakeKeyFrameData(data, nullptr), Rigid3d(), i > 0 ? KeyFrameId(0, 1, i) : KeyFrameId());
    ASSERT_TRUE(map.AddObservation(MapPointId(0, 1, 1), data.id, 0));
  }
  map.RefreshDerived();
  EXPECT_EQ(map.point(MapPointId(0, 1, 1)).descriptor, map.keyframe(KeyFrameId(0, 1, 3)).data->features.descriptors[0]);
}

TEST_F(SmallMapTest, AFeatureShowsOneLandmarkAndAKeyFrameSeesItOnce) {
  const MapPointId a = AddPoint(1, {{0, 3}, {1, 5}});
  const MapPointId b = AddPoint(2, {{0, 4}, {1, 6}});
  EXPECT_FALSE(map_.AddObservation(a, ids_[0], 7));  // sees it already
  EXPECT_FALSE(map_.AddObservation(b, ids_[1], 5));  // taken
  EXPECT_EQ(map_.point(a).observations.size(), 2u);
  EXPECT_EQ(map_.keyframe(ids_[1]).landmarks[5], a);
}

TEST_F(SmallMapTest, MergedPointKeepsWhatBothSaw) {
  const MapPointId from = AddPoint(1, {{0, 3}, {2, 5}});
  const MapPointId into = AddPoint(2, {{0, 4}, {1, 6}});
  map_.MergePoints(from, into);
  EXPECT_EQ(map_.FindPoint(from), nullptr);
  EXPECT_EQ(map_.point(into).observations, (std::vector<Observation>{{ids_[0], 4}, {ids_[1], 6}, {ids_[2], 5}}));
  EXPECT_FALSE(map_.keyframe(ids_[0]).landmarks[3].IsValid());  // the feature is free again
  const MapDelta delta = map_.TakeDelta();
  ASSERT_EQ(delta.removed_points.size(), 1u);
  EXPECT_EQ(delta.removed_points[0].replaced_by, into);
}

TEST_F(SmallMapTest, RemovedKeyFrameLeavesChildrenToItsParentAndTakesItsPointsWithIt) {
  const MapPointId stays = AddPoint(1, {{0, 1}, {1, 1}, {2, 1}});
  const MapPointId goes = AddPoint(2, {{1, 2}, {2, 2}});
  map_.RemoveKeyFrame(ids_[1]);
  EXPECT_EQ(map_.keyframe(ids_[2]).parent, ids_[0]);
  EXPECT_EQ(map_.point(stays).observations.size(), 2u);
  EXPECT_EQ(map_.FindPoint(goes), nullptr);
  const MapDelta delta = map_.TakeDelta();
  ASSERT_EQ(delta.removed_keyframes.size(), 1u);
  EXPECT_EQ(delta.removed_keyframes[0].anchor, ids_[0]);
  EXPECT_LT((delta.removed_keyframes[0].removed_from_anchor.translation - Eigen::Vector3d(-1, 0, 0)).norm(), 1e-12);
  EXPECT_THAT(ValidateMap(map_), IsEmpty());
}

TEST_F(SmallMapTest, MisuseIsCaught) {
  EXPECT_THROW(map_.RemoveKeyFrame(ids_[0]), CheckFailure);  // the root
  EXPECT_THROW(map_.RemovePoint(MapPointId(0, 1, 99)), CheckFailure);
  EXPECT_THROW(map_.AddPoint(MapPointId(0, 1, 1), Eigen::Vector3f::Constant(std::nanf(""))), CheckFailure);
  EXPECT_THROW(map_.AddKeyFrame(map_.keyframe(ids_[0]).data, Rigid3d(), ids_[1]), CheckFailure);  // twice
  const MapPointId id = AddPoint(1, {{0, 3}, {1, 5}});
  EXPECT_THROW(map_.AddPoint(id, {0, 0, 1}), CheckFailure);
  EXPECT_THROW(map_.AddObservation(id, ids_[2], RandomEdits::kFeatures), CheckFailure);
  EXPECT_THROW(map_.MergePoints(id, id), CheckFailure);
}

TEST_F(SmallMapTest, MedianDepthIsOfTheKeyFramesOwnPoints) {
  EXPECT_EQ(map_.MedianDepth(ids_[0]), 0);
  for (uint32_t i = 1; i <= 3; ++i) map_.SetPosition(AddPoint(i, {{0, i}, {1, i}}), {0, 0, static_cast<float>(i * i)});
  EXPECT_DOUBLE_EQ(map_.MedianDepth(ids_[0]), 4);
  EXPECT_EQ(map_.MedianDepth(ids_[2]), 0);
}

TEST_F(SmallMapTest, CovisibleKeyFramesAreBoundedMostFirst) {
  for (uint32_t i = 0; i < 3; ++i) AddPoint(i + 1, {{0, i}, {1, i}});
  AddPoint(9, {{0, 9}, {2, 9}});
  EXPECT_EQ(map_.CovisibleKeyFrames(ids_[0], 1, 1), (std::vector<std::pair<KeyFrameId, int>>{{ids_[1], 3}}));
  EXPECT_EQ(map_.CovisibleKeyFrames(ids_[0], 2), (std::vector<std::pair<KeyFrameId, int>>{{ids_[1], 3}}));
  EXPECT_EQ(map_.CovisibleKeyFrames(ids_[0], 1).size(), 2u);
  EXPECT_THAT(map_.CovisibleKeyFrames(KeyFrameId(0, 1, 77), 1), IsEmpty());
}

TEST_F(SmallMapTest, HashSeesEveryPartOfTheState) {
  const MapPointId id = AddPoint(1, {{0, 3}, {1, 5}});
  std::set<uint64_t> hashes = {HashMap(map_)};
  const auto expect_new_hash = [&](const char* what) { EXPECT_TRUE(hashes.insert(HashMap(map_)).second) << what; };
  map_.SetPosition(id, {0, 0, 4.0000005f});
  expect_new_hash("position");
  map_.SetPose(ids_[2], Rigid3d(Eigen::Quaterniond::Identity(), {1e-12, 0, 0}));
  expect_new_hash("pose");
  map_.SetParent(ids_[2], ids_[0]);
  expect_new_hash("parent");
  ASSERT_TRUE(map_.AddObservation(id, ids_[2], 1));
  expect_new_hash("observation");
  map_.RemovePoint(id);
  expect_new_hash("point");
}

TEST_F(SmallMapTest, DataWithoutAppearanceKeepsWhatDistancesComeFrom) {
  const KeyFrameData& whole = *map_.keyframe(ids_[0]).data;
  const auto bare = WithoutAppearance(whole);
  EXPECT_EQ(bare->id, whole.id);
  EXPECT_EQ(bare->stamp.ns, whole.stamp.ns);
  EXPECT_EQ(bare->features.size(), whole.features.size());
  EXPECT_EQ(bare->features.octaves, whole.features.octaves);
  EXPECT_FALSE(bare->features.HasAppearance());
  EXPECT_TRUE(whole.features.HasAppearance());
  EXPECT_THROW(map_.ReplaceData(ids_[1], bare), CheckFailure);  // another's
}

}  // namespace
}  // namespace portolan
