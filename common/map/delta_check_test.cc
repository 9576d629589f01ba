#include "map/delta_check.h"

#include <gmock/gmock.h>

#include <cmath>
#include <functional>
#include <limits>

#include "map/random_edits.h"
#include "testing/broken_maps.h"
#include "testing/map_builder.h"

namespace portolan {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;

const MapPointId kNewPoint(0, 1, 5000);

/// A map and an empty delta that follows it, for tests to fill with contradictions.
class ContradictionTest : public ::testing::Test {
 protected:
  ContradictionTest() : edits_(11, &map_) {
    for (int i = 0; i < 150; ++i) edits_.Next();
    static_cast<void>(map_.TakeDelta());
    delta_.map = map_.id();
    delta_.epoch = map_.epoch();
    delta_.base_revision = map_.revision();
    delta_.revision = map_.revision() + 1;
    root_ = Find([](const KeyFrame& k) { return !k.parent.IsValid(); });
    leaf_ = Find([this](const KeyFrame& k) { return map_.Children(k.data->id).empty() && k.parent.IsValid(); });
    inner_ = Find([this](const KeyFrame& k) { return !map_.Children(k.data->id).empty() && k.parent.IsValid(); });
  }

  KeyFrameId Find(const std::function<bool(const KeyFrame&)>& wanted) {
    for (const auto& [id, keyframe] : map_.keyframes()) {
      if (wanted(keyframe)) return id;
    }
    ADD_FAILURE() << "no such keyframe";
    return {};
  }
  MapDelta::KeyFrameState StateOf(KeyFrameId id) {
    return {id, map_.keyframe(id).camera_from_map, map_.keyframe(id).parent,
            static_cast<uint32_t>(RandomEdits::kFeatures)};
  }
  uint32_t FreeFeature(KeyFrameId id) {
    for (uint32_t i = 0;; ++i) {
      if (!map_.keyframe(id).landmarks[i].IsValid()) return i;
    }
  }
  /// The delta is refused with these words, and nothing of it is done.
  void ExpectRefused(const char* words) {
    const uint64_t before = HashMap(map_);
    const Status status = map_.Apply(delta_, edits_.FindData());
    ASSERT_FALSE(status.ok()) << "expected: " << words;
    EXPECT_THAT(status.error().message, HasSubstr(words));
    EXPECT_EQ(HashMap(map_), before);
    EXPECT_EQ(map_.revision(), delta_.base_revision);
  }
  void ExpectApplied() {
    const Status status = map_.Apply(delta_, edits_.FindData());
    ASSERT_TRUE(status.ok()) << status.error().message;
    EXPECT_THAT(ValidateMap(map_), IsEmpty());
  }

  Map map_{MapId(0, 1, 1), 2};
  RandomEdits edits_;
  MapDelta delta_;
  KeyFrameId root_, leaf_, inner_;
};

TEST_F(ContradictionTest, TwoPointsClaimOneFeature) {
  const uint32_t feature = FreeFeature(root_);
  delta_.points = {{kNewPoint, {0, 0, 1}}, {MapPointId(0, 1, 5001), {0, 0, 1}}};
  for (const auto& state : delta_.points) {
    delta_.observations.push_back({state.id, root_, static_cast<int32_t>(feature)});
    delta_.observations.push_back({state.id, leaf_, static_cast<int32_t>(FreeFeature(leaf_))});
  }
  ExpectRefused("is another landmark's");
}

TEST_F(ContradictionTest, FeatureIsTakenByALandmarkThatStays) {
  const MapPointId holder = edits_.SomePoint();
  const Observation held = map_.point(holder).observations[0];
  const KeyFrameId other = held.keyframe == root_ ? leaf_ : root_;
  delta_.points = {{kNewPoint, {0, 0, 1}}};
  delta_.observations = {{kNewPoint, held.keyframe, static_cast<int32_t>(held.feature)},
                         {kNewPoint, other, static_cast<int32_t>(FreeFeature(other))}};
  ExpectRefused("is another landmark's");
  delta_.removed_points = {{holder, kNewPoint}};  // now it gives the feature up
  ExpectApplied();
}

TEST_F(ContradictionTest, DuplicateEntries) {
  const MapPointId point = edits_.SomePoint();
  const MapDelta clean = delta_;
  delta_.points = {{point, {0, 0, 1}}, {point, {0, 0, 2}}};
  ExpectRefused("is in the delta twice");
  delta_ = clean;
  delta_.keyframes = {StateOf(leaf_), StateOf(leaf_)};
  ExpectRefused("is in the delta twice");
  delta_ = clean;
  delta_.removed_points = {{point, {}}, {point, {}}};
  ExpectRefused("is removed twice");
  delta_ = clean;
  delta_.removed_keyframes = {{leaf_, root_, {}}, {leaf_, root_, {}}};
  ExpectRefused("is removed twice");
  delta_ = clean;
  const Observation seen = map_.point(point).observations[0];
  delta_.observations = {{point, seen.keyframe, static_cast<int32_t>(seen.feature)}, {point, seen.keyframe, -1}};
  ExpectRefused("is in the delta twice");
}

TEST_F(ContradictionTest, BothRemovedAndChanged) {
  const MapPointId point = edits_.SomePoint();
  const MapDelta clean = delta_;
  delta_.removed_points = {{point, {}}};
  delta_.points = {{point, {0, 0, 1}}};
  ExpectRefused("both removed and changed");
  delta_ = clean;
  delta_.removed_keyframes = {{leaf_, root_, {}}};
  delta_.keyframes = {StateOf(leaf_)};
  ExpectRefused("both removed and changed");
}

TEST_F(ContradictionTest, TreeMustStayATree) {
  const MapDelta clean = delta_;
  delta_.keyframes = {StateOf(inner_)};
  delta_.keyframes[0].parent = map_.Children(inner_)[0];
  ExpectRefused("circle");
  delta_.keyframes[0].parent = inner_;
  ExpectRefused("circle");
  delta_.keyframes[0].parent = KeyFrameId();
  ExpectRefused("2 roots");
  delta_.keyframes = {StateOf(root_)};
  delta_.keyframes[0].parent = leaf_;
  ExpectRefused("0 roots");
  delta_ = clean;
  delta_.removed_keyframes = {{root_, leaf_, {}}};
  ExpectRefused("0 roots");
  delta_.removed_keyframes = {{inner_, root_, {}}};
  ExpectRefused("parent of");
  // Turned over in one delta, it stays a tree.
  delta_ = clean;
  delta_.keyframes = {StateOf(root_), StateOf(inner_)};
  delta_.keyframes[0].parent = inner_;
  delta_.keyframes[1].parent = KeyFrameId();
  ExpectApplied();
}

TEST_F(ContradictionTest, NewKeyFramesMayNotHangOnEachOther) {
  Random random(1);
  std::vector<std::shared_ptr<const KeyFrameData>> data;
  for (uint32_t i = 0; i < 2; ++i) {
    data.push_back(RandomEdits::MakeData(KeyFrameId(0, 1, 7000 + i), &random));
    delta_.keyframes.push_back(
        {data[i]->id, Rigid3d(), KeyFrameId(0, 1, 7001 - i), static_cast<uint32_t>(RandomEdits::kFeatures)});
  }
  const auto find_data = [&](KeyFrameId id) { return data[id.sequence() - 7000]; };
  EXPECT_FALSE(map_.Apply(delta_, find_data).ok());
  delta_.keyframes[1].parent = leaf_;  // the first hangs on the second, which comes later in the delta
  EXPECT_TRUE(map_.Apply(delta_, find_data).ok());
  EXPECT_THAT(ValidateMap(map_), IsEmpty());
}

TEST_F(ContradictionTest, PointsNeedTwoKeyFrames) {
  const MapDelta clean = delta_;
  delta_.points = {{kNewPoint, {0, 0, 1}}};
  ExpectRefused("fewer than two");
  delta_.observations = {{kNewPoint, root_, static_cast<int32_t>(FreeFeature(root_))}};
  ExpectRefused("fewer than two");
  delta_ = clean;
  const MapPointId thinned = edits_.SomePoint();
  for (const Observation& o : map_.point(thinned).observations)
    delta_.observations.push_back({thinned, o.keyframe, -1});
  delta_.observations.pop_back();
  ExpectRefused("fewer than two");
  delta_.removed_points = {{thinned, {}}};
  delta_.observations.clear();
  ExpectApplied();
}

TEST_F(ContradictionTest, RemovedKeyFrameMayNotLeavePointsBehind) {
  const KeyFrameId lonely = Find([this](const KeyFrame& k) {
    if (!map_.Children(k.data->id).empty() || !k.parent.IsValid()) return false;
    return std::any_of(k.landmarks.begin(), k.landmarks.end(),
                       [this](MapPointId id) { return id.IsValid() && map_.point(id).observations.size() == 2; });
  });
  delta_.removed_keyframes = {{lonely, map_.keyframe(lonely).parent, {}}};
  ExpectRefused("fewer than two");
}

TEST_F(ContradictionTest, ChainsOfReplacementsEnd) {
  const MapPointId a = edits_.SomePoint();
  MapPointId b = a;
  while (b == a) b = edits_.SomePoint();
  delta_.removed_points = {{a, a}};
  ExpectRefused("replacing point");
  delta_.removed_points = {{a, b}, {b, a}};
  ExpectRefused("replacing point");
  delta_.removed_points = {{a, kNewPoint}};
  ExpectRefused("replacing point");
  delta_.removed_points.clear();
  delta_.removed_keyframes = {{leaf_, leaf_, {}}};
  ExpectRefused("anchor");
  delta_.removed_keyframes.clear();
  delta_.removed_points = {{a, b}, {b, MapPointId()}};
  ExpectApplied();
}

TEST_F(ContradictionTest, ValuesBeyondAnyMap) {
  const MapPointId point = edits_.SomePoint();
  delta_.points = {{point, {0, 0, 1e30f}}};
  ExpectRefused("position");
  delta_.points.clear();
  delta_.keyframes = {StateOf(leaf_)};
  delta_.keyframes[0].camera_from_map.translation.x() = -1e200;
  ExpectRefused("rigid motion");
  delta_.keyframes = {StateOf(leaf_)};
  delta_.keyframes[0].num_features = 1;
  ExpectRefused("number of features");
}

TEST_F(ContradictionTest, OriginIsChecked) {
  delta_.points = {{edits_.SomePoint(), {0, 0, 1}}};
  const MapDelta good = delta_;
  const auto expect_refused = [&](const char* words) {
    const uint64_t before = HashMap(map_);
    const Status status = map_.Apply(delta_, edits_.FindData());
    ASSERT_FALSE(status.ok()) << words;
    EXPECT_THAT(status.error().message, HasSubstr(words));
    EXPECT_EQ(HashMap(map_), before);
    delta_ = good;
  };
  delta_.map = MapId(0, 1, 2);
  expect_refused("for map");
  delta_.epoch = 1;
  expect_refused("epoch 1 for a map in epoch 2");
  delta_.epoch = 3;
  expect_refused("a snapshot must come first");
  ++delta_.base_revision, ++delta_.revision;
  expect_refused("from revision");
  delta_.revision = delta_.base_revision;
  expect_refused("back to");
  ExpectApplied();
}

TEST(DeltaCheck, RefusesEveryBrokenDelta) {
  SyntheticSceneOptions options;
  options.num_clutter = 20;
  options.num_views = 5;
  const SyntheticScene scene = MakeSyntheticScene(options);
  MapBuilderOptions builder;
  builder.num_keyframes = 4;
  Map map = BuildMap(scene, builder);
  static_cast<void>(map.TakeDelta());
  const uint64_t before = HashMap(map);
  for (const BrokenDelta& broken : MakeBrokenDeltas(map, scene, 4)) {
    EXPECT_FALSE(map.Apply(broken.delta, DataOf(scene)).ok()) << broken.name;
    EXPECT_EQ(HashMap(map), before) << broken.name;
  }
  const Status good = map.Apply(MakeGoodDelta(map, scene, 4), DataOf(scene));
  EXPECT_TRUE(good.ok()) << good.error().message;
  EXPECT_THAT(ValidateMap(map), IsEmpty());
}

/// Spoils a delta in one place or a few, with ids that exist here or there, repeated elements, wild numbers.
void Spoil(RandomEdits* edits, MapDelta* delta) {
  Random& random = *edits->random();
  const auto pick = [&](auto& list) -> auto& {
    return list[random.Below(list.size())];
  };
  const auto any_point = [&] {
    return random.Below(6) == 0 ? MapPointId(0, 1, static_cast<uint32_t>(random.Below(400))) : edits->SomePoint();
  };
  const auto any_keyframe = [&] {
    return random.Below(6) == 0 ? KeyFrameId(0, 1, static_cast<uint32_t>(random.Below(80))) : edits->SomeKeyFrame();
  };
  const double wild[] = {std::nan(""), std::numeric_limits<double>::infinity(), 1e300, -1e30, 0};
  switch (random.Below(13)) {
    case 0:
      delta->removed_points.push_back({any_point(), random.Below(2) == 0 ? any_point() : MapPointId()});
      break;
    case 1:
      delta->removed_keyframes.push_back({any_keyframe(), any_keyframe(), edits->SomePose()});
      break;
    case 2:
      delta->observations.push_back({any_point(), any_keyframe(), static_cast<int32_t>(random.Below(34)) - 2});
      break;
    case 3:
      delta->points.push_back({any_point(), edits->SomePosition()});
      break;
    case 4:
      delta->keyframes.push_back(
          {any_keyframe(), edits->SomePose(), any_keyframe(), static_cast<uint32_t>(RandomEdits::kFeatures)});
      break;
    case 5:
      if (!delta->observations.empty()) pick(delta->observations).feature = static_cast<int32_t>(random.Below(34)) - 2;
      break;
    case 6:
      if (!delta->observations.empty()) pick(delta->observations).point = any_point();
      break;
    case 7:
      if (!delta->observations.empty()) pick(delta->observations).keyframe = any_keyframe();
      break;
    case 8:
      if (!delta->keyframes.empty())
        pick(delta->keyframes).parent = random.Below(4) == 0 ? KeyFrameId() : any_keyframe();
      break;
    case 9:
      if (!delta->keyframes.empty()) pick(delta->keyframes).camera_from_map.translation.y() = wild[random.Below(5)];
      break;
    case 10:
      if (!delta->points.empty()) pick(delta->points).position_in_map.y() = static_cast<float>(wild[random.Below(5)]);
      break;
    case 11:
      if (!delta->observations.empty())
        delta->observations.erase(delta->observations.begin() +
                                  static_cast<ptrdiff_t>(random.Below(delta->observations.size())));
      break;
    case 12:
      if (!delta->keyframes.empty()) delta->keyframes.pop_back();
      break;
  }
}

class HostileDeltaTest : public ::testing::TestWithParam<uint64_t> {};

TEST_P(HostileDeltaTest, IsRefusedWholeOrLeavesAValidMap) {
  Map owner(MapId(0, 1, 1), 1);
  RandomEdits edits(GetParam(), &owner);
  Map replica(owner.id());
  int refused = 0, applied = 0;
  for (int round = 0; round < 60; ++round) {
    for (int i = 0; i < 6; ++i) edits.Next();
    const MapDelta delta = owner.TakeDelta();
    if (delta.IsEmpty()) continue;
    for (int attack = 0; attack < 15; ++attack) {
      MapDelta spoilt = delta;
      for (uint64_t i = 0; i <= edits.random()->Below(3); ++i) Spoil(&edits, &spoilt);
      Map victim = replica;
      const uint64_t before = HashMap(victim);
      const Status status = victim.Apply(spoilt, edits.FindData());
      ASSERT_THAT(ValidateMap(victim), IsEmpty()) << "round " << round << " attack " << attack;
      if (!status.ok()) {
        ASSERT_EQ(HashMap(victim), before);
      }
      ++(status.ok() ? applied : refused);
    }
    ASSERT_TRUE(replica.Apply(delta, edits.FindData()).ok());
  }
  EXPECT_GT(refused, 200);
  EXPECT_GT(applied, 50);
}

INSTANTIATE_TEST_SUITE_P(Seeds, HostileDeltaTest, ::testing::Range<uint64_t>(1, 9));

}  // namespace
}  // namespace portolan
