#include "map_optimization/map_fusion.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <limits>
#include <set>

#include "base/random.h"
#include "map_optimization/map_correction.h"
#include "testing/map_comparison.h"
#include "testing/synthetic_scene.h"

namespace portolan {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;

// The map has even views below, the other odd ones from there.
constexpr size_t kNumViews = 100, kMapEnd = 60, kOtherBegin = 36;
constexpr size_t kMatched = 48, kCurrent = 49;

/// How far the similarity of verification is off: some pixels.
Sim3d SmallError(uint64_t seed) {
  Random random(seed);
  Vector7d twist;
  for (int i = 0; i < 7; ++i) twist[i] = 0.004 * random.Gaussian();
  return ExpSim3(twist);
}

/// A street on which one map's way ends while another's, in a frame and scale of its own, begins a little earlier.
class MapFusionTest : public ::testing::TestWithParam<uint64_t> {
 protected:
  void SetUp() override { Build(GetParam(), 0, 0); }

  void Build(uint64_t seed, double pixel_sigma, double other_drift) {
    SyntheticSceneOptions options;
    options.landmarks = LandmarkLayout::kStreet;
    options.motion = CameraMotion::kStreetLap;
    options.num_landmarks = 4000;
    options.num_views = kNumViews;
    options.lap = 60;
    options.travel = 0.3 * (kNumViews - 1);
    options.sight = 6;
    options.num_clutter = 50;
    options.descriptor_flip_ratio = 0.03;
    options.pixel_sigma_px = pixel_sigma;
    options.seed = seed;
    scene_ = MakeSyntheticScene(options);
    Random random(seed);
    Vector7d twist;
    for (int i = 0; i < 7; ++i) twist[i] = 0.5 * random.Gaussian();
    map_ = BuildPart({0, 2, 1}, 3, 0, kMapEnd, ExpSim3(twist), 0);
    for (int i = 0; i < 7; ++i) twist[i] = 0.5 * random.Gaussian();
    other_ = BuildPart({0, 2, 2}, 4, kOtherBegin + 1, kNumViews, ExpSim3(twist), other_drift);
    map_scale_ = map_from_world_.at(kMatched).scale;
    overlap_ = OverlapOf(kCurrent, kMatched);
  }

  LoopClosure OverlapOf(size_t current, size_t matched) const {
    LoopClosure overlap;
    overlap.current = id(current);
    overlap.matched = id(matched);
    overlap.current_from_matched = Sim3d(other_.keyframe(overlap.current).camera_from_map) *
                                   map_from_world_.at(current) * map_from_world_.at(matched).Inverse() *
                                   Sim3d(map_.keyframe(overlap.matched).camera_from_map).Inverse();
    overlap.current_from_matched = overlap.current_from_matched * SmallError(GetParam());
    return overlap;
  }

  /// Every second view from `begin` on. `drift`: of the scale, in all, from the first to the last.
  Map BuildPart(MapId map_id, uint32_t session, size_t begin, size_t end, const Sim3d& map_from_world, double drift) {
    Map map(map_id, 7);
    std::map<int, std::vector<std::pair<size_t, uint32_t>>> sightings;
    KeyFrameId parent;
    Sim3d around = map_from_world;
    for (size_t view = begin; view < end; view += 2) {
      const SyntheticView& seen = scene_.views[view];
      if (parent.IsValid()) {  // grows about the camera
        const Eigen::Vector3d centre = around * seen.camera_from_world.TargetOriginInSource();
        const double growth = std::exp(2 * drift / static_cast<double>(end - begin));
        around = Sim3d(growth, Eigen::Quaterniond::Identity(), (1 - growth) * centre) * around;
      }
      map_from_world_[view] = around;
      map.AddKeyFrame(seen.data, TransformPose(seen.camera_from_world, around), parent);
      parent = seen.data->id;
      for (size_t feature = 0; feature < seen.landmark_of_feature.size(); ++feature) {
        if (seen.landmark_of_feature[feature] != kNoLandmark)
          sightings[seen.landmark_of_feature[feature]].emplace_back(view, static_cast<uint32_t>(feature));
      }
    }
    for (const auto& [landmark, seen] : sightings) {
      if (seen.size() < 2) continue;
      const MapPointId point(0, session, static_cast<uint32_t>(landmark) + 1);
      const Eigen::Vector3d in_world = scene_.landmarks_in_world[static_cast<size_t>(landmark)];
      map.AddPoint(point, (map_from_world_.at(seen[seen.size() / 2].first) * in_world).cast<float>());
      for (const auto& [view, feature] : seen) map.AddObservation(point, id(view), feature);
    }
    static_cast<void>(map.TakeDelta());
    return map;
  }

  KeyFrameId id(size_t view) const { return scene_.views[view].data->id; }
  Result<MapCorrection> Propose() { return ProposeFusion(map_, other_, overlap_, options_, nullptr, &times_); }
  Map Fused(const MapCorrection& correction) const {
    Map fused = map_;
    const auto applied = ApplyFusion(correction, other_, &fused);
    EXPECT_TRUE(applied.ok()) << (applied.ok() ? "" : applied.error().message);
    static_cast<void>(fused.TakeDelta());
    return fused;
  }

  SyntheticScene scene_;
  std::map<size_t, Sim3d> map_from_world_;  // around each view, of the map it is in
  Map map_, other_;
  double map_scale_ = 1;
  LoopClosure overlap_;
  LoopCorrectionOptions options_;
  StageTimes times_;
};

INSTANTIATE_TEST_SUITE_P(Seeds, MapFusionTest, ::testing::Range<uint64_t>(1, 6));

TEST_P(MapFusionTest, MakesOneValidMapOfTwo) {
  const auto correction = Propose();
  ASSERT_TRUE(correction.ok()) << correction.error().message;
  const Map fused = Fused(*correction);
  EXPECT_THAT(ValidateMap(fused), IsEmpty());
  EXPECT_EQ(fused.keyframes().size(), map_.keyframes().size() + other_.keyframes().size());
  const MapError error = CompareWithScene(fused, scene_);
  EXPECT_LT(error.camera_rmse, 0.01);
  EXPECT_LT(error.max_rotation_rad, 0.01);
  EXPECT_LT(error.median_point, 0.01);
  EXPECT_NEAR(error.truth_from_map.scale * map_scale_, 1, 0.005) << "the map keeps its scale";
}

TEST_P(MapFusionTest, WhatTheMapHadStaysWhereItWas) {
  const auto correction = Propose();
  ASSERT_TRUE(correction.ok());
  const Map fused = Fused(*correction);
  for (const auto& [keyframe_id, keyframe] : map_.keyframes()) {
    EXPECT_EQ(fused.keyframe(keyframe_id).camera_from_map.translation, keyframe.camera_from_map.translation);
    EXPECT_EQ(fused.keyframe(keyframe_id).parent, keyframe.parent);
  }
  for (const auto& [keyframe_id, keyframe] : other_.keyframes())
    EXPECT_EQ(fused.keyframe(keyframe_id).data, keyframe.data);
  const std::set<std::pair<MapPointId, MapPointId>> merges(correction->merges.begin(), correction->merges.end());
  std::set<MapPointId> merged;
  for (const auto& [from, into] : merges) merged.insert(from);
  for (const Map* map : {&map_, &other_}) {
    for (const auto& [point_id, point] : map->points())
      EXPECT_EQ(fused.FindPoint(point_id) == nullptr, merged.count(point_id) == 1) << point_id;
  }
}

TEST_P(MapFusionTest, DuplicatesAroundTheOverlapAreMerged) {
  const auto correction = Propose();
  ASSERT_TRUE(correction.ok());
  const Map fused = Fused(*correction);
  EXPECT_GT(correction->merges.size(), 200u);
  size_t wrong = 0;
  for (const auto& [from, into] : correction->merges) wrong += from.sequence() != into.sequence();
  EXPECT_LE(wrong, correction->merges.size() / 100);
  EXPECT_GT(fused.Covisibility(overlap_.current, overlap_.matched), 50);
  EXPECT_EQ(correction->loop_edges.front(), std::make_pair(overlap_.current, overlap_.matched));
  EXPECT_EQ(fused.keyframe(overlap_.current).parent, overlap_.matched);
}

/// Windows are small, so that most of the way side by side is welded from keyframe to keyframe.
TEST_P(MapFusionTest, WeldsTheMapsWhereverTheyRunSideBySide) {
  Build(GetParam(), 0.3, 0.1);
  options_.max_window = 6;
  options_.max_matched_side = 6;
  overlap_ = OverlapOf(kOtherBegin + 3, kOtherBegin + 2);
  const auto correction = Propose();
  ASSERT_TRUE(correction.ok()) << correction.error().message;
  const Map fused = Fused(*correction);
  EXPECT_THAT(ValidateMap(fused), IsEmpty());
  for (const size_t view : {kOtherBegin + 3, kOtherBegin + 11, kMapEnd - 5})
    EXPECT_GT(fused.Covisibility(id(view), id(view + 1)), 40) << view;
  for (const auto& keyframe : correction->keyframes) {
    const Rigid3d pose = MakeRigid(keyframe.camera_from_map);
    EXPECT_LT((pose.translation - fused.keyframe(keyframe.id).camera_from_map.translation).norm(), 1e-9);
  }
  size_t wrong = 0;
  for (const auto& [from, into] : correction->merges) wrong += from.sequence() != into.sequence();
  EXPECT_LE(wrong, correction->merges.size() / 100);
}

TEST_P(MapFusionTest, SaysWhatItIs) {
  const auto correction = Propose();
  ASSERT_TRUE(correction.ok());
  EXPECT_EQ(correction->kind, "fusion");
  EXPECT_EQ(correction->map, map_.id());
  EXPECT_EQ(correction->other, other_.id());
  EXPECT_EQ(correction->epoch, map_.epoch());
  EXPECT_EQ(correction->made_from_revision, map_.revision());
  EXPECT_EQ(correction->keyframes.size(), other_.keyframes().size());
  EXPECT_NEAR(correction->map_from_other.scale, map_scale_ / map_from_world_.at(kCurrent).scale,
              0.02 * correction->map_from_other.scale);
  for (const auto& keyframe : correction->keyframes) {
    EXPECT_NE(other_.FindKeyFrame(keyframe.id), nullptr);
    EXPECT_NEAR(keyframe.camera_from_map.scale * correction->map_from_other.scale, 1, 0.02)
        << "in units of the other map";
  }
  for (const char* stage : {"fusion_join", "fusion_window", "fusion_fusion", "fusion_welding", "fusion_graph"}) {
    EXPECT_EQ(times_.samples().count(stage), 1u) << stage;
  }
}

TEST_P(MapFusionTest, NoiseAndDriftOfTheOtherMapDoNotTearThemApart) {
  Build(GetParam(), 0.5, 0.15);
  const auto correction = Propose();
  ASSERT_TRUE(correction.ok()) << correction.error().message;
  const Map fused = Fused(*correction);
  EXPECT_THAT(ValidateMap(fused), IsEmpty());
  const MapError alone = CompareWithScene(other_, scene_);
  EXPECT_LT(CompareWithScene(fused, scene_).camera_rmse, 2 * alone.camera_rmse + 0.1);
  EXPECT_GT(fused.Covisibility(overlap_.current, overlap_.matched), 40);
}

/// The owner's maps went on since the proposal: keyframes and points that it does not know.
TEST_P(MapFusionTest, YoungerKeyFramesOfBothMapsAreIncluded) {
  const Map map_then = map_, other_then = other_;
  for (size_t view : {kMapEnd - 2, kMapEnd - 4}) map_.RemoveKeyFrame(id(view));
  for (size_t view = kNumViews - 1; view > kNumViews - 12; view -= 2) other_.RemoveKeyFrame(id(view));
  const auto correction = Propose();
  ASSERT_TRUE(correction.ok()) << correction.error().message;
  map_ = map_then;
  other_ = other_then;
  const Map fused = Fused(*correction);
  EXPECT_THAT(ValidateMap(fused), IsEmpty());
  EXPECT_EQ(fused.keyframes().size(), map_.keyframes().size() + other_.keyframes().size());
  EXPECT_LT(CompareWithScene(fused, scene_).camera_rmse, 0.01);
}

TEST_P(MapFusionTest, ElementsThatAreGoneArePassedOver) {
  const auto correction = Propose();
  ASSERT_TRUE(correction.ok());
  other_.RemoveKeyFrame(overlap_.current);
  map_.RemoveKeyFrame(overlap_.matched);
  for (size_t i = 0; i < correction->merges.size(); i += 3) {
    if (other_.FindPoint(correction->merges[i].first) != nullptr) other_.RemovePoint(correction->merges[i].first);
  }
  const Map fused = Fused(*correction);
  EXPECT_THAT(ValidateMap(fused), IsEmpty());
  EXPECT_LT(CompareWithScene(fused, scene_).camera_rmse, 0.01);
}

/// The overlap is at the other map's end, so that the tree must be turned.
TEST_P(MapFusionTest, TheTreeIsTurnedToBeginAtTheOverlap) {
  const Map first = other_, second = map_;
  other_ = second;
  map_ = first;
  overlap_ = LoopClosure();
  overlap_.current = id(kMatched);
  overlap_.matched = id(kCurrent);
  overlap_.current_from_matched = Sim3d(other_.keyframe(id(kMatched)).camera_from_map) * map_from_world_.at(kMatched) *
                                  map_from_world_.at(kCurrent).Inverse() *
                                  Sim3d(map_.keyframe(id(kCurrent)).camera_from_map).Inverse();
  const auto correction = Propose();
  ASSERT_TRUE(correction.ok()) << correction.error().message;
  const Map fused = Fused(*correction);
  EXPECT_THAT(ValidateMap(fused), IsEmpty());
  EXPECT_EQ(fused.keyframe(id(kMatched)).parent, id(kCurrent));
  EXPECT_EQ(fused.keyframe(id(kMatched - 2)).parent, id(kMatched)) << "was its parent";
  EXPECT_EQ(fused.keyframe(id(kMatched + 2)).parent, id(kMatched)) << "was its child";
  EXPECT_LT(CompareWithScene(fused, scene_).camera_rmse, 0.01);
}

TEST_P(MapFusionTest, TheDeltaTakesAReplicaToTheFusedMap) {
  const auto correction = Propose();
  ASSERT_TRUE(correction.ok());
  Map fused = map_, replica = map_;
  ASSERT_TRUE(ApplyFusion(*correction, other_, &fused).ok());
  const auto applied = replica.Apply(fused.TakeDelta(), [&](KeyFrameId keyframe) {
    const KeyFrame* found = other_.FindKeyFrame(keyframe);
    return found != nullptr ? found->data : nullptr;
  });
  ASSERT_TRUE(applied.ok()) << applied.error().message;
  EXPECT_EQ(HashMap(replica), HashMap(fused));
}

TEST_P(MapFusionTest, LeavesItsInputAloneAndIsDeterministic) {
  const uint64_t map_hash = HashMap(map_), other_hash = HashMap(other_);
  const auto a = Propose(), b = Propose();
  ASSERT_TRUE(a.ok() && b.ok());
  EXPECT_EQ(HashMap(Fused(*a)), HashMap(Fused(*b)));
  EXPECT_EQ(HashMap(map_), map_hash);
  EXPECT_EQ(HashMap(other_), other_hash);
}

class MapFusionRefusalTest : public MapFusionTest {};
INSTANTIATE_TEST_SUITE_P(OneSeed, MapFusionRefusalTest, ::testing::Values<uint64_t>(1));

TEST_P(MapFusionRefusalTest, AWrongOverlapIsRefused) {
  overlap_.matched = id(2);  // elsewhere in the street
  const auto correction = Propose();
  ASSERT_FALSE(correction.ok());
  EXPECT_THAT(correction.error().message, HasSubstr("fusion correction: "));
  EXPECT_THAT(correction.error().message, HasSubstr("expected at least"));
}

TEST_P(MapFusionRefusalTest, RefusesOverlapsThatAreNone) {
  const auto refuses = [&](const LoopClosure& overlap, const Map& other, const std::string& because) {
    const auto correction = ProposeFusion(map_, other, overlap, options_, nullptr, nullptr);
    ASSERT_FALSE(correction.ok()) << because;
    EXPECT_THAT(correction.error().message, HasSubstr(because));
  };
  LoopClosure overlap = overlap_;
  overlap.current = overlap_.matched;
  refuses(overlap, other_, "is not in map " + ToString(other_.id()));
  overlap = overlap_;
  overlap.matched = overlap_.current;
  refuses(overlap, other_, "is not in map " + ToString(map_.id()));
  overlap = overlap_;
  overlap.current_from_matched.scale = -1;
  refuses(overlap, other_, "no similarity");
  overlap = overlap_;
  overlap.current = id(kMatched - 2);
  refuses(overlap, map_, "with itself");
  Map sharing = other_;
  sharing.AddKeyFrame(scene_.views[0].data, Rigid3d(), overlap_.current);
  refuses(overlap_, sharing, "keyframe " + ToString(id(0)) + " is in map");
  Map points = other_;
  points.AddPoint(map_.SortedPointIds()[0], {1, 1, 1});
  refuses(overlap_, points, "point " + ToString(map_.SortedPointIds()[0]) + " is in map");
}

/// One had its lens taken out, the other not (yet): their features of one place are pixels apart at the rim.
TEST_P(MapFusionRefusalTest, MapsWhoseFeaturesDifferByTheLensWait) {
  const PinholeCamera camera = scene_.views[0].data->camera;
  const RadialResidual lens{1e-4, 0};
  const auto before = Propose();
  ASSERT_TRUE(before.ok());
  EXPECT_TRUE(CheckResiduals(map_, other_).ok());
  other_.SetResidual(camera, lens);
  EXPECT_FALSE(CheckResiduals(map_, other_).ok());
  const auto early = Propose();
  ASSERT_FALSE(early.ok());
  EXPECT_THAT(early.error().message, HasSubstr("another residual"));
  const uint64_t hash = HashMap(map_);
  EXPECT_FALSE(ApplyFusion(*before, other_, &map_).ok());
  EXPECT_EQ(HashMap(map_), hash);

  // The map's frames were taken without it, and it does not know: it learns it with the other's.
  Map adapted(map_.id(), map_.epoch());
  const MapDelta state = map_.Snapshot();
  ASSERT_TRUE(adapted.Apply(state, [&](KeyFrameId id) { return WithResidual(map_.keyframe(id).data, lens); }).ok());
  map_ = adapted;
  const auto fusion = Propose();
  ASSERT_TRUE(fusion.ok()) << fusion.error().message;
  ASSERT_TRUE(ApplyFusion(*fusion, other_, &map_).ok());
  EXPECT_EQ(map_.residuals(), other_.residuals());
}

TEST_P(MapFusionRefusalTest, StopEndsIt) {
  const std::atomic<bool> stop{true};
  const auto correction = ProposeFusion(map_, other_, overlap_, options_, &stop, nullptr);
  ASSERT_FALSE(correction.ok());
  EXPECT_THAT(correction.error().message, HasSubstr("interrupted"));
}

TEST_P(MapFusionRefusalTest, TheOwnerRefusesWhatDoesNotFit) {
  const auto correction = Propose();
  ASSERT_TRUE(correction.ok());
  const auto refuses = [&](const std::function<void(MapCorrection*)>& spoil, const std::string& because) {
    MapCorrection spoilt = *correction;
    spoil(&spoilt);
    const uint64_t before = HashMap(map_);
    const auto result = ApplyFusion(spoilt, other_, &map_);
    ASSERT_FALSE(result.ok()) << because;
    EXPECT_THAT(result.error().message, HasSubstr(because));
    EXPECT_EQ(HashMap(map_), before);
  };
  refuses([](MapCorrection* c) { c->kind = "loop"; }, "expected a fusion");
  refuses([](MapCorrection* c) { c->map = MapId(4, 4, 4); }, "the map here");
  refuses([](MapCorrection* c) { c->other = MapId(4, 4, 4); }, "the other map here");
  refuses([](MapCorrection* c) { c->epoch = 77; }, "epoch 77");
  refuses([](MapCorrection* c) { c->made_from_revision = 999; }, "revision 999");
  refuses([](MapCorrection* c) { c->map_from_other.scale = 0; }, "no similarity");
  refuses([](MapCorrection* c) { c->map_from_other.translation.x() = std::numeric_limits<double>::quiet_NaN(); },
          "no similarity");
  refuses([](MapCorrection* c) { c->keyframes[0].camera_from_map.scale = 0; }, "not a similarity");
  refuses([](MapCorrection* c) { c->points[0].position_in_map.x() = std::numeric_limits<float>::infinity(); },
          "not finite");
  refuses([](MapCorrection* c) { c->map_from_other.translation.x() = 1e300; }, "beyond any map");
  refuses([](MapCorrection* c) { c->points[0].position_in_map.x() = 2e9f; }, "beyond any map");
  refuses([](MapCorrection* c) { c->loop_edges.clear(); }, "none of its 0 loop edges");
  refuses(
      [](MapCorrection* c) {
        c->loop_edges = {{KeyFrameId(9, 9, 9), KeyFrameId(9, 9, 8)}};
      },
      "none of its 1 loop edges");
  const Map whole = std::exchange(other_, Map(other_.id(), 1));
  refuses([](MapCorrection*) {}, "is empty");
  other_ = whole;
  Map loop_owner = map_;
  const auto as_loop = ApplyMapCorrection(*correction, &loop_owner);
  ASSERT_FALSE(as_loop.ok()) << "a fusion is no correction of the map alone";
}

}  // namespace
}  // namespace portolan
