#include "mapping/local_mapper.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <map>

#include "geometry/sim3_alignment.h"
#include "map_optimization/map_correction.h"
#include "map_optimization/map_fusion.h"
#include "mapping/fused_maps.h"
#include "mapping/mapping_test_scene.h"
#include "testing/matchers.h"

namespace portolan {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;

const auto kNoMoreWork = [] { return false; };

/// A mapper on a noisy scene, fed by a tracker that finds all landmarks, with a replica that follows its deltas.
class Mapper : public ::testing::Test {
 protected:
  void SetUp() override {
    TestSceneOptions options;
    options.num_points = 900;
    options.pixel_sigma = 0.3;
    options.flipped_bits = 15;
    options.clutter = 100;
    scene_ = std::make_unique<TestScene>(options);
    views_ = SeeAlongPath(scene_.get(), 10, 0.4);
    for (const TestView& view : views_) data_[view.data->id] = view.data;
    mapper_ =
        std::make_unique<LocalMapper>(MapperOptions(), kMap, 5, &point_ids_, [this](MapDelta delta) { Follow(delta); });
  }
  void Follow(const MapDelta& delta) {
    ++deltas_;
    const Status applied = replica_.Apply(delta, [this](KeyFrameId id) { return data_.at(id); });
    ASSERT_TRUE(applied.ok()) << applied.error().message;
    EXPECT_EQ(HashMap(replica_), HashMap(mapper_->map()));
    EXPECT_THAT(ValidateMap(replica_), IsEmpty());
  }
  Status Initialize() {
    KeyFrameMessage message;
    message.kind = KeyFrameKind::kInitialSecond;
    message.initial_matches = TrueMatches(views_[0], views_[3]);
    return mapper_->Initialize(views_[0].data, views_[3].data, message);
  }
  /// The pose that the tracker would find, from the landmarks: in the map's frame and scale, a bit off.
  KeyFrameMessage Track(const TestView& view) {
    KeyFrameMessage message = TrackedMessage(mapper_->map(), view, views_);
    message.camera_from_map = TransformPose(view.camera_from_map, MapFromWorld());
    message.camera_from_map.translation += Eigen::Vector3d(0.002, -0.002, 0.001);
    return message;
  }
  Sim3d MapFromWorld() const {
    std::vector<Eigen::Vector3d> world, map;
    for (const MapPointId id : mapper_->map().SortedPointIds()) {
      const MapPoint& point = mapper_->map().point(id);
      const int truth = TruePointOf(point, views_);
      if (truth < 0) continue;
      world.push_back(scene_->points_in_map()[static_cast<size_t>(truth)]);
      map.push_back(point.position_in_map.cast<double>());
    }
    return *AlignPoints(world, map);
  }
  CameraResidual Known(const RadialResidual& residual) const { return {views_[0].data->camera, residual}; }
  void RunAll() {
    ASSERT_TRUE(Initialize().ok());
    for (const size_t k : {1, 2, 4, 5, 6, 7, 8, 9}) {
      const Status processed = mapper_->Process(views_[k].data, Track(views_[k]), kNoMoreWork, nullptr);
      ASSERT_TRUE(processed.ok()) << processed.error().message;
    }
  }

  const MapId kMap{1, 1, 1};
  std::unique_ptr<TestScene> scene_;
  std::vector<TestView> views_;
  std::map<KeyFrameId, std::shared_ptr<const KeyFrameData>> data_;
  IdMinter<MapPointId> point_ids_{1, 3};
  std::unique_ptr<LocalMapper> mapper_;
  Map replica_{kMap};
  int deltas_ = 0;
};

TEST_F(Mapper, BuildsAnAccurateMapThatReplicasFollow) {
  RunAll();
  EXPECT_GT(deltas_, 9);
  EXPECT_EQ(HashMap(replica_), HashMap(mapper_->map()));
  EXPECT_EQ(replica_.epoch(), 5u);
  EXPECT_THAT(ValidateMap(mapper_->map()), IsEmpty());
  EXPECT_GT(mapper_->map().points().size(), 300u);
  const Sim3d map_from_world = MapFromWorld();
  for (const auto& [id, keyframe] : mapper_->map().keyframes()) {
    const TestView& view = views_[id.sequence() - 1];
    const Eigen::Vector3d error =
        keyframe.camera_from_map.TargetOriginInSource() - map_from_world * view.camera_from_map.TargetOriginInSource();
    // A feature's sigma at depth 7 and octave 5 is 0.3 * 2.5 / 500 * 7 = 0.01 world units; a pose, from over 100 of
    // them on points about as uncertain, is not worse than five of these.
    EXPECT_LT(error.norm() / map_from_world.scale, 0.05);
  }
}

TEST_F(Mapper, TakesAResidualOutOfAllKeyFramesWhichReplicasFollow) {
  RunAll();
  const RadialResidual lens{0.01, 0};
  MapCorrection stale = EmptyCorrection(mapper_->map(), "loop");
  const auto& [newest, keyframe_then] = *mapper_->map().keyframes().rbegin();
  stale.keyframes.push_back({newest, Sim3d(keyframe_then.camera_from_map)});
  const MapCorrection adaptation = AdaptToResidual(mapper_->map(), Known(lens), nullptr);
  const Status taken = mapper_->TakeResidual(Known(lens), adaptation);
  ASSERT_TRUE(taken.ok()) << taken.error().message;
  for (const auto& [id, keyframe] : replica_.keyframes()) EXPECT_EQ(keyframe.data->residual, lens);
  EXPECT_EQ(HashMap(replica_), HashMap(mapper_->map()));
  const Status late = mapper_->ApplyCorrection(stale);
  ASSERT_FALSE(late.ok()) << "it was made with features that are no more";
  EXPECT_THAT(late.error().message, HasSubstr("residual"));
}

TEST_F(Mapper, AdaptsAgainToAMapThatWasCorrectedMeanwhile) {
  RunAll();
  const RadialResidual lens{0.01, 0};
  const MapCorrection adaptation = AdaptToResidual(mapper_->map(), Known(lens), nullptr);
  MapCorrection loop = EmptyCorrection(mapper_->map(), "loop");
  const auto& [newest, keyframe] = *mapper_->map().keyframes().rbegin();
  Rigid3d moved = keyframe.camera_from_map;
  moved.translation.x() += 0.01;
  loop.keyframes.push_back({newest, Sim3d(moved)});
  ASSERT_TRUE(mapper_->ApplyCorrection(loop).ok());
  const uint64_t before = HashMap(mapper_->map());
  EXPECT_FALSE(mapper_->TakeResidual(Known(lens), adaptation).ok());
  EXPECT_EQ(HashMap(mapper_->map()), before);
  EXPECT_TRUE(mapper_->TakeResidual(Known(lens), AdaptToResidual(mapper_->map(), Known(lens), nullptr)).ok());
}

TEST_F(Mapper, TheSameInputGivesTheSameMap) {
  RunAll();
  const uint64_t first = HashMap(mapper_->map());
  point_ids_ = IdMinter<MapPointId>(1, 3);
  SetUp();
  replica_ = Map(kMap);
  RunAll();
  EXPECT_EQ(HashMap(mapper_->map()), first);
}

TEST_F(Mapper, ARefusedPairLeavesTheMapEmpty) {
  KeyFrameMessage message;
  EXPECT_FALSE(mapper_->Initialize(views_[0].data, views_[3].data, message).ok());
  EXPECT_TRUE(mapper_->map().keyframes().empty());
  EXPECT_EQ(deltas_, 0);
  EXPECT_TRUE(Initialize().ok()) << "and the next one may come";
  EXPECT_FALSE(Initialize().ok()) << "but not twice";
}

TEST_F(Mapper, RefusesKeyFramesThatDoNotFit) {
  ASSERT_TRUE(Initialize().ok());
  const uint64_t before = HashMap(mapper_->map());
  const auto refuses = [&](size_t view, const KeyFrameMessage& message, const std::string& because) {
    const Status status = mapper_->Process(views_[view].data, message, kNoMoreWork, nullptr);
    ASSERT_FALSE(status.ok()) << because;
    EXPECT_THAT(status.error().message, HasSubstr(because));
    EXPECT_EQ(HashMap(mapper_->map()), before);
  };
  KeyFrameMessage message = Track(views_[1]);
  refuses(0, message, "already");
  message.reference = KeyFrameId(6, 6, 6);
  refuses(1, message, "reference 6.");
  message = Track(views_[1]);
  message.landmarks.resize(5);
  refuses(1, message, "landmarks");
  message = Track(views_[1]);
  for (auto& [feature, landmark] : message.landmarks) landmark = MapPointId(6, 6, 6);
  // Nor is it where its pose says.
  message.camera_from_map = Rigid3d(ExpSO3({0, 1, 0}), {3, 0, 0}) * message.camera_from_map;
  refuses(1, message, "landmarks");
}

TEST_F(Mapper, AKeyFrameThatComesAgainToAnOlderMapIsFoundByItsPose) {
  ASSERT_TRUE(Initialize().ok());
  for (const size_t k : {1, 2})
    ASSERT_TRUE(mapper_->Process(views_[k].data, Track(views_[k]), kNoMoreWork, nullptr).ok());
  const Map older = mapper_->map();
  for (const size_t k : {4, 5})
    ASSERT_TRUE(mapper_->Process(views_[k].data, Track(views_[k]), kNoMoreWork, nullptr).ok());
  KeyFrameMessage message = Track(views_[6]);
  message.reference = views_[2].data->id;
  const auto is_known = [&](const auto& seen) { return older.FindPoint(seen.second) != nullptr; };
  message.landmarks.erase(std::remove_if(message.landmarks.begin(), message.landmarks.end(), is_known),
                          message.landmarks.end());
  ASSERT_GT(message.landmarks.size(), 15u) << "the newer map has landmarks of its own";

  LocalMapper successor(MapperOptions(), older, 6, &point_ids_, [](const MapDelta&) {});
  const Status processed = successor.Process(views_[6].data, message, kNoMoreWork, nullptr);
  ASSERT_TRUE(processed.ok()) << processed.error().message;
  EXPECT_THAT(successor.map().keyframe(views_[6].data->id).camera_from_map,
              RigidNear(message.camera_from_map, (PoseTolerance{0.01, 0.02})));
  EXPECT_THAT(ValidateMap(successor.map()), IsEmpty());
}

TEST_F(Mapper, BusyOnlyInsertsAndExtends) {
  ASSERT_TRUE(Initialize().ok());
  ASSERT_TRUE(mapper_
                  ->Process(
                      views_[4].data, Track(views_[4]), [] { return true; }, nullptr)
                  .ok());
  EXPECT_EQ(mapper_->stage_times().samples().count("local_ba"), 0u);
  EXPECT_EQ(mapper_->stage_times().samples().count("fuse"), 0u);
  EXPECT_EQ(mapper_->stage_times().samples().at("extend").size(), 1u);
}

TEST_F(Mapper, TheTrackersPoseIsBroughtUpToTheMap) {
  ASSERT_TRUE(Initialize().ok());
  KeyFrameMessage message = Track(views_[4]);
  const Rigid3d expected = TransformPose(views_[4].camera_from_map, MapFromWorld());
  message.camera_from_map.translation += Eigen::Vector3d(0.02, 0.02, 0);
  ASSERT_TRUE(mapper_->InsertKeyFrame(views_[4].data, message).ok());
  const Rigid3d inserted = mapper_->map().keyframe(views_[4].data->id).camera_from_map;
  EXPECT_LT((inserted.TargetOriginInSource() - expected.TargetOriginInSource()).norm(), 0.01);
}

TEST_F(Mapper, ANewOwnerGoesOn) {
  RunAll();
  IdMinter<MapPointId> other_ids(2, 9);
  LocalMapper successor(MapperOptions(), replica_, 6, &other_ids, [this](MapDelta delta) { Follow(delta); });
  const TestView next = scene_->See(CameraAt({3.8, 0, 0}));
  views_.push_back(next);
  data_[next.data->id] = next.data;
  const KeyFrameMessage message = Track(next);
  mapper_ = std::make_unique<LocalMapper>(std::move(successor));
  mapper_->PublishSnapshot();
  ASSERT_TRUE(mapper_->Process(next.data, message, kNoMoreWork, nullptr).ok());
  EXPECT_EQ(replica_.epoch(), 6u);
}

TEST_F(Mapper, AppliesACorrectionAndPublishesIt) {
  RunAll();
  MapCorrection correction;
  correction.map = kMap;
  correction.epoch = 5;
  correction.made_from_revision = mapper_->map().revision();
  const Sim3d new_from_old(2.0, ExpSO3({0, 0.1, 0}), {1, 0, 0});
  for (const auto& [id, keyframe] : mapper_->map().keyframes()) {
    correction.keyframes.push_back({id, Sim3d(keyframe.camera_from_map) * new_from_old.Inverse()});
  }
  const uint64_t before = HashMap(replica_);
  ASSERT_TRUE(mapper_->ApplyCorrection(correction).ok());
  EXPECT_NE(HashMap(replica_), before);
  correction.epoch = 4;
  EXPECT_FALSE(mapper_->ApplyCorrection(correction).ok());
}

/// A mapper that hung has two of them in its queue: the loop, and what was made from the map without it when nobody had
/// answered for the loop.
TEST_F(Mapper, RefusesACorrectionFromBeforeTheLastOne) {
  RunAll();
  const auto moved_by = [&](const std::string& kind, double x) {
    MapCorrection correction = EmptyCorrection(mapper_->map(), kind);
    for (const auto& [id, keyframe] : mapper_->map().keyframes()) {
      correction.keyframes.push_back(
          {id, Sim3d(keyframe.camera_from_map) * Sim3d(1, Eigen::Quaterniond::Identity(), {x, 0, 0})});
    }
    return correction;
  };
  const MapCorrection loop = moved_by("loop", 0.5), stale = moved_by("global_ba", 0);
  ASSERT_TRUE(mapper_->ApplyCorrection(loop).ok());
  const uint64_t with_loop = HashMap(mapper_->map());
  const Status undone = mapper_->ApplyCorrection(stale);
  ASSERT_FALSE(undone.ok());
  EXPECT_THAT(undone.error().message, HasSubstr("the map was corrected at"));
  EXPECT_EQ(HashMap(mapper_->map()), with_loop);
  EXPECT_TRUE(mapper_->ApplyCorrection(moved_by("global_ba", 0.1)).ok()) << "made anew, from the map with the loop";
}

/// A second map of the same place, by the same process: every second view, in a frame of its own.
class FusingMapper : public Mapper {
 protected:
  void SetUp() override {
    Mapper::SetUp();
    RunAll();
    for (int k = 0; k < 6; ++k) other_views_.push_back(scene_->See(CameraAt({0.3 + 0.4 * k, 0.05, 0}, {0, 0.02, 0})));
    for (const TestView& view : other_views_) data_[view.data->id] = view.data;
    views_.insert(views_.end(), other_views_.begin(), other_views_.end());
    other_ = std::make_unique<LocalMapper>(MapperOptions(), kOther, 2, &point_ids_, [](const MapDelta&) {});
    KeyFrameMessage message;
    message.kind = KeyFrameKind::kInitialSecond;
    message.initial_matches = TrueMatches(other_views_[0], other_views_[3]);
    ASSERT_TRUE(other_->Initialize(other_views_[0].data, other_views_[3].data, message).ok());
    for (const size_t k : {1, 2, 4})
      ASSERT_TRUE(other_->Process(other_views_[k].data, TrackInOther(k), kNoMoreWork, nullptr).ok()) << k;
  }
  KeyFrameMessage TrackInOther(size_t k) const {
    KeyFrameMessage message = TrackedMessage(other_->map(), other_views_[k], views_);
    message.camera_from_map = TransformPose(other_views_[k].camera_from_map, OtherFromWorld());
    message.map = kOther;
    return message;
  }
  Sim3d OtherFromWorld() const {
    const auto of = [](const Rigid3d& pose) { return pose.TargetOriginInSource(); };
    const Rigid3d a = other_->map().keyframe(other_views_[0].data->id).camera_from_map,
                  b = other_->map().keyframe(other_views_[3].data->id).camera_from_map;
    const double scale =
        (of(a) - of(b)).norm() / (of(other_views_[0].camera_from_map) - of(other_views_[3].camera_from_map)).norm();
    const Sim3d units(scale, Eigen::Quaterniond::Identity(), Eigen::Vector3d::Zero());
    return Sim3d(a).Inverse() * units * Sim3d(other_views_[0].camera_from_map);
  }
  Result<MapCorrection> Propose() const {
    LoopClosure overlap;
    overlap.current = other_views_[0].data->id;
    overlap.matched = views_[0].data->id;
    overlap.current_from_matched = Sim3d(other_->map().keyframe(overlap.current).camera_from_map) * OtherFromWorld() *
                                   MapFromWorld().Inverse() *
                                   Sim3d(mapper_->map().keyframe(overlap.matched).camera_from_map).Inverse();
    return ProposeFusion(mapper_->map(), other_->map(), overlap, LoopCorrectionOptions(), nullptr, nullptr);
  }

  const MapId kOther{1, 1, 2};
  std::vector<TestView> other_views_;
  std::unique_ptr<LocalMapper> other_;
};

TEST_F(FusingMapper, TakesAnotherMapInAndPublishesIt) {
  const size_t keyframes = mapper_->map().keyframes().size() + other_->map().keyframes().size();
  const auto fusion = Propose();
  ASSERT_TRUE(fusion.ok()) << fusion.error().message;
  EXPECT_GT(fusion->merges.size(), 100u);
  ASSERT_TRUE(mapper_->TakeIn(*other_, *fusion).ok());  // the replica follows: see Follow
  EXPECT_EQ(mapper_->map().keyframes().size(), keyframes);
  EXPECT_EQ(replica_.keyframes().size(), keyframes);
}

/// The tracker has not heard of it: what it names is followed.
TEST_F(FusingMapper, AKeyFrameOfTheOtherMapGoesOnInThisOne) {
  KeyFrameMessage late = TrackInOther(5);
  const auto fusion = Propose();
  ASSERT_TRUE(fusion.ok());
  FusedMaps fused;
  fused.Note(other_->map(), kMap, fusion->map_from_other);
  ASSERT_TRUE(mapper_->TakeIn(*other_, *fusion).ok());
  ASSERT_TRUE(fused.Redirect([&](MapId) { return &mapper_->map(); }, &late));
  const Status processed = mapper_->Process(other_views_[5].data, late, kNoMoreWork, nullptr);
  ASSERT_TRUE(processed.ok()) << processed.error().message;
  const KeyFrame& inserted = mapper_->map().keyframe(other_views_[5].data->id);
  const Rigid3d expected = TransformPose(other_views_[5].camera_from_map, MapFromWorld());
  EXPECT_LT(
      (inserted.camera_from_map.TargetOriginInSource() - expected.TargetOriginInSource()).norm() / MapFromWorld().scale,
      0.05);
}

TEST_F(FusingMapper, RefusesAProposalFromBeforeACorrection) {
  const auto fusion = Propose();
  ASSERT_TRUE(fusion.ok());
  MapCorrection correction = EmptyCorrection(mapper_->map(), "global_ba");
  for (const auto& [id, keyframe] : mapper_->map().keyframes()) {
    correction.keyframes.push_back(
        {id, Sim3d(keyframe.camera_from_map) * Sim3d(1, Eigen::Quaterniond::Identity(), {1, 0, 0})});
  }
  ASSERT_TRUE(mapper_->ApplyCorrection(correction).ok());
  const uint64_t before = HashMap(mapper_->map());
  const Status taken = mapper_->TakeIn(*other_, *fusion);
  ASSERT_FALSE(taken.ok());
  EXPECT_THAT(taken.error().message, HasSubstr("was corrected"));
  EXPECT_EQ(HashMap(mapper_->map()), before);
  const auto again = Propose();
  ASSERT_TRUE(again.ok());
  EXPECT_TRUE(mapper_->TakeIn(*other_, *again).ok());
}

/// A fusion leaves this map's keyframes where they are, and hangs the other's on them.
TEST_F(FusingMapper, ACorrectionFromBeforeAFusionTakesTheOtherMapAlong) {
  const auto fusion = Propose();
  ASSERT_TRUE(fusion.ok());
  const Sim3d new_from_old(1.5, ExpSO3({0, 0.1, 0}), {1, 0, 0});
  MapCorrection loop = EmptyCorrection(mapper_->map(), "loop");
  for (const auto& [id, keyframe] : mapper_->map().keyframes())
    loop.keyframes.push_back({id, Sim3d(keyframe.camera_from_map) * new_from_old.Inverse()});
  ASSERT_TRUE(mapper_->TakeIn(*other_, *fusion).ok());
  const KeyFrameId others = other_->map().keyframes().rbegin()->first;
  const auto centre = [&] { return mapper_->map().keyframe(others).camera_from_map.TargetOriginInSource(); };
  const Eigen::Vector3d before = centre();
  const Status applied = mapper_->ApplyCorrection(loop);
  ASSERT_TRUE(applied.ok()) << applied.error().message;
  EXPECT_LT((centre() - new_from_old * before).norm(), 1e-6);
}

TEST_F(FusingMapper, RefusesAProposalFromBeforeTheMapsFeaturesChanged) {
  const RadialResidual lens{0.001, 0};
  const auto fusion = Propose();
  ASSERT_TRUE(fusion.ok());
  const auto adapt = [&](LocalMapper* mapper) {
    return mapper->TakeResidual(Known(lens), AdaptToResidual(mapper->map(), Known(lens), nullptr));
  };
  ASSERT_TRUE(adapt(mapper_.get()).ok());
  const uint64_t before = HashMap(mapper_->map());
  EXPECT_FALSE(mapper_->TakeIn(*other_, *fusion).ok());
  const auto too_early = Propose();
  ASSERT_FALSE(too_early.ok()) << "the other map has it in its features";
  EXPECT_THAT(too_early.error().message, HasSubstr("another residual"));
  ASSERT_TRUE(adapt(other_.get()).ok());
  EXPECT_FALSE(mapper_->TakeIn(*other_, *fusion).ok());
  EXPECT_EQ(HashMap(mapper_->map()), before);
  const auto again = Propose();
  ASSERT_TRUE(again.ok()) << again.error().message;
  EXPECT_TRUE(mapper_->TakeIn(*other_, *again).ok());
  for (const auto& [id, keyframe] : mapper_->map().keyframes()) EXPECT_EQ(keyframe.data->residual, lens);
}

}  // namespace
}  // namespace portolan
