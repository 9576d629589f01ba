#include "atlas/map_joiner.h"

#include <gmock/gmock.h>

#include "atlas/atlas_test_world.h"
#include "atlas/two_maps_test_scene.h"
#include "testing/matchers.h"

namespace portolan {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

constexpr PoseTolerance kExact{1e-9, 1e-9};

class MapJoinerTest : public AtlasWorld {
 protected:
  void SeeOverlap(RobotId robot, MapId map, MapId other) {
    joiner_.OnOverlap(robot, Overlap(map, other), now_);
    Collect();
  }
  /// All replicas are as far as their owners.
  std::optional<FusionTask> NextFusion() {
    return joiner_.NextFusion([this](MapId id) { return EpochOf(id); }, [](MapId, MapId) { return true; }, now_);
  }
  MapCorrection Propose(const FusionTask& task) {
    MapCorrection correction;
    correction.kind = "fusion";
    correction.map = task.map;
    correction.other = task.other;
    correction.map_from_other = Sim3d(1.6, Eigen::Quaterniond::Identity(), {1, 2, 3.1});  // refined
    joiner_.OnProposed(correction, now_);
    return joiner_.TakeCorrection().value();
  }
  void AnswerFusion(const MapCorrection& correction, const std::string& refusal = "") {
    MapperState state;
    state.process = kMapper;
    state.correction_process = correction.process;
    state.correction_number = correction.number;
    state.correction_refusal = refusal;
    state.map = correction.map;
    state.revision = 77;
    joiner_.OnMapperState(state, now_);
    Collect();
  }
  static Request Order(uint32_t number) {
    Request order;
    order.id = RequestId(0, 77, number);
    return order;
  }
  void LookAtKeyFrames(MapId map, int count) {
    for (int i = 0; i < count; ++i) joiner_.OnKeyFrame(map);
  }
};

TEST_F(MapJoinerTest, FromALargeMapTheTrackerSwitches) {
  StartInNewMap(60, 51);
  ASSERT_TRUE(joiner_.WantsOverlap(3, kNew, kOld, now_));
  SeeOverlap(3, kNew, kOld);
  const auto activations = Commands(CommandKind::kActivateMap);
  ASSERT_THAT(activations, SizeIs(1));
  EXPECT_EQ(activations[0].map, kOld);
  EXPECT_EQ(activations[0].other, kNew);
  EXPECT_EQ(activations[0].robot, 3);
  EXPECT_FALSE(activations[0].owner.IsValid());
  EXPECT_THAT(activations[0].map_from_other, Sim3Near(OldFromNew(), kExact, 1e-9));
  EXPECT_THAT(Commands(CommandKind::kGrantOwnership), IsEmpty()) << "not before the tracker is there";
  EXPECT_FALSE(joiner_.WantsOverlap(3, kNew, kOld, now_)) << "one proposal at a time";

  Ask(kTracker, "enter_map", kOld, kNew, "", OldFromNew());
  Track(kTracker, kOld);
  EXPECT_EQ(joiner_.counters().switches, 1u);
  EXPECT_EQ(Owner(kOld), kMapper);
  EXPECT_EQ(atlas_.graph().ActivityOf(kOld, kNew), 2u);
  EXPECT_EQ(atlas_.graph().FindLink(kOld, kNew)->origin, MapGraph::Origin::kOverlap);
  ASSERT_THAT(joiner_.records(), SizeIs(1));
  EXPECT_TRUE(joiner_.records()[0].is_done);
  EXPECT_EQ(joiner_.records()[0].keyframes, 51u);
  // Not back at once.
  EXPECT_FALSE(joiner_.WantsOverlap(3, kOld, kNew, now_));
  LookAtKeyFrames(kOld, JoinOptions().retry_keyframes);
  EXPECT_TRUE(joiner_.WantsOverlap(3, kOld, kNew, now_));
}

TEST_F(MapJoinerTest, ARefusedSwitchIsTriedAgainAfterSomeKeyFrames) {
  StartInNewMap(60, 51);
  SeeOverlap(3, kNew, kOld);
  EXPECT_TRUE(ReplyTo(Ask(kTracker, "refuse_map", kOld, kNew, "12 points found")).ok);
  EXPECT_THAT(joiner_.records().at(0).problem, HasSubstr("12 points found"));
  EXPECT_EQ(joiner_.counters().refused, 1u);
  LookAtKeyFrames(kNew, JoinOptions().retry_keyframes - 1);
  SeeOverlap(3, kNew, kOld);
  EXPECT_THAT(Commands(CommandKind::kActivateMap), SizeIs(1));
  LookAtKeyFrames(kNew, 1);
  SeeOverlap(3, kNew, kOld);
  EXPECT_THAT(Commands(CommandKind::kActivateMap), SizeIs(2));
}

TEST_F(MapJoinerTest, ATrackerThatDoesNotAnswerHoldsNobodyUp) {
  StartInNewMap(60, 51);
  SeeOverlap(3, kNew, kOld);
  Go(JoinOptions().switch_patience_s + 0.5);
  EXPECT_THAT(joiner_.records().at(0).problem, HasSubstr("no answer"));
  EXPECT_EQ(joiner_.num_open(), 0u);
}

TEST_F(MapJoinerTest, ATrackerThatDiesEndsItsSwitch) {
  StartInNewMap(60, 51);
  SeeOverlap(3, kNew, kOld);
  Die(kTracker);
  Go(Atlas::kGoneS + 0.5);
  EXPECT_THAT(joiner_.records().at(0).problem, HasSubstr("gone"));
  EXPECT_EQ(joiner_.num_open(), 0u);
}

TEST_F(MapJoinerTest, AStatusTellsOfASwitchWhoseRequestWasLost) {
  StartInNewMap(60, 51);
  SeeOverlap(3, kNew, kOld);
  Track(kTracker, kOld);
  Go(0.25);
  EXPECT_EQ(joiner_.counters().switches, 1u);
}

TEST_F(MapJoinerTest, ASmallMapIsFused) {
  StartInNewMap(60, 50);
  SeeOverlap(3, kNew, kOld);
  // First one mapper owns both, ...
  const auto grants = Commands(CommandKind::kGrantOwnership);
  ASSERT_THAT(grants, SizeIs(1));
  EXPECT_EQ(grants[0].map, kOld);
  EXPECT_EQ(grants[0].owner, kMapper);
  EXPECT_EQ(grants[0].epoch, 3u);
  EXPECT_THAT(Commands(CommandKind::kActivateMap), IsEmpty());
  // ... then the replicas have its epoch, ...
  EXPECT_FALSE(joiner_.NextFusion([](MapId) { return Epoch{1}; }, [](MapId, MapId) { return true; }, now_));
  // ... and agree about what the calibration left, ...
  EXPECT_FALSE(joiner_.NextFusion([this](MapId id) { return EpochOf(id); },
                                  [](MapId map, MapId other) { return map == other; }, now_));
  const auto task = NextFusion();
  ASSERT_TRUE(task);
  EXPECT_EQ(task->map, kOld);
  EXPECT_EQ(task->other, kNew);
  EXPECT_FALSE(NextFusion()) << "it is being proposed";
  EXPECT_TRUE(joiner_.IsFusing(kNew));
  Go(30);  // the proposal takes its time, and the maps stay where they are
  EXPECT_EQ(Owner(kOld), kMapper);
  // ... then it is proposed, and the fact published once the owner has applied it.
  const MapCorrection correction = Propose(*task);
  EXPECT_EQ(correction.process, kServer);
  EXPECT_EQ(correction.number, 1u);
  EXPECT_THAT(Commands(CommandKind::kFuseMaps), IsEmpty());
  AnswerFusion(correction);
  const auto fusions = Commands(CommandKind::kFuseMaps);
  ASSERT_THAT(fusions, SizeIs(1));
  EXPECT_EQ(fusions[0].map, kOld);
  EXPECT_EQ(fusions[0].other, kNew);
  EXPECT_THAT(fusions[0].map_from_other, Sim3Near(correction.map_from_other, kExact, 1e-9));
  const auto done = joiner_.TakeDone();
  ASSERT_THAT(done, SizeIs(1));
  EXPECT_EQ(done[0].revision, 77u);
  EXPECT_EQ(joiner_.counters().fusions, 1u);
  EXPECT_FALSE(joiner_.IsFusing(kOld));
  EXPECT_EQ(atlas_.maps().count(kNew), 0u);
  Go(5);  // the tracker says for a while that it is in the map that is no more
  EXPECT_EQ(Owner(kOld), kMapper);
  EXPECT_EQ(atlas_.MapOf(kTracker), kOld);
}

TEST_F(MapJoinerTest, AFusionThatTheMapperRefusesLeavesBothMaps) {
  StartInNewMap(60, 20);
  SeeOverlap(3, kNew, kOld);
  MapCorrection first = Propose(*NextFusion());
  AnswerFusion(first, "made from another epoch");
  EXPECT_THAT(joiner_.records(), IsEmpty()) << "it is proposed anew";
  AnswerFusion(first, "made from another epoch");  // told again
  const MapCorrection second = Propose(*NextFusion());
  EXPECT_EQ(second.number, 2u);
  AnswerFusion(second, "made from another epoch");
  AnswerFusion(Propose(*NextFusion()), "made from another epoch");
  EXPECT_THAT(joiner_.records().at(0).problem, HasSubstr("made from another epoch"));
  EXPECT_THAT(Commands(CommandKind::kFuseMaps), IsEmpty());
  EXPECT_FALSE(joiner_.WantsOverlap(3, kNew, kOld, now_));
  Go(3);
  EXPECT_EQ(Owner(kOld), kServer) << "dormant again";
  EXPECT_EQ(Owner(kNew), kMapper);
  LookAtKeyFrames(kNew, JoinOptions().retry_keyframes);
  EXPECT_TRUE(joiner_.WantsOverlap(3, kNew, kOld, now_));
}

TEST_F(MapJoinerTest, AFusionThatCannotBeProposedEnds) {
  StartInNewMap(60, 20);
  SeeOverlap(3, kNew, kOld);
  ASSERT_TRUE(NextFusion());
  joiner_.OnProposed(Error{"too little in common"}, now_);
  EXPECT_FALSE(joiner_.TakeCorrection());
  EXPECT_THAT(joiner_.records().at(0).problem, HasSubstr("too little in common"));
}

TEST_F(MapJoinerTest, AnAnswerThatDoesNotComeEndsTheFusion) {
  StartInNewMap(60, 20);
  SeeOverlap(3, kNew, kOld);
  Propose(*NextFusion());
  Go(JoinOptions().answer_patience_s + 0.5);
  EXPECT_THAT(joiner_.records().at(0).problem, HasSubstr("no answer"));
  EXPECT_EQ(joiner_.num_open(), 0u);
}

TEST_F(MapJoinerTest, AMapperThatDiesIsReplacedInAFusion) {
  StartInNewMap(60, 20);
  SeeOverlap(3, kNew, kOld);
  const ProcessId successor(3, 30, 1);
  Die(kMapper);
  Go(2);
  Live(successor, "backend_mapper");
  Ask(successor, "register_mapper");
  Go(1);
  EXPECT_EQ(Owner(kNew), successor);
  EXPECT_EQ(Owner(kOld), successor);
  EXPECT_TRUE(NextFusion());
}

TEST_F(MapJoinerTest, WithoutAMapperPatienceEnds) {
  StartInNewMap(60, 20);
  SeeOverlap(3, kNew, kOld);
  Die(kMapper);
  Go(JoinOptions().grant_patience_s + 1);
  EXPECT_THAT(joiner_.records().at(0).problem, HasSubstr("no mapper came to own both maps"));
}

TEST_F(MapJoinerTest, AMapBegunBesideAnotherIsNotFusedWithItAgain) {
  StartInNewMap(60, 20);
  Ask(kTracker, "link_maps", kNew, kOld, "", OldFromNew().Inverse());
  EXPECT_FALSE(joiner_.WantsOverlap(3, kNew, kOld, now_));
  atlas_.OnSize(kNew, 51);
  EXPECT_TRUE(joiner_.WantsOverlap(3, kNew, kOld, now_)) << "it leads to a switch";
}

TEST_F(MapJoinerTest, EmptyMapsAreNotLookedIn) {
  StartInNewMap(0, 20);
  EXPECT_FALSE(joiner_.WantsOverlap(3, kNew, kOld, now_));
}

TEST_F(MapJoinerTest, OfTwoRobotsMapsTheSmallerGoesToTheLargersOwner) {
  StartInNewMap(60, 30);
  StartOtherRobot(100);
  SeeOverlap(3, kNew, kOthers);
  EXPECT_EQ(Owner(kNew), kOtherMapper);
  EXPECT_EQ(Owner(kOthers), kOtherMapper);
  const auto task = NextFusion();
  ASSERT_TRUE(task);
  EXPECT_EQ(task->map, kOthers);
  EXPECT_EQ(task->other, kNew);
  Go(5);
  EXPECT_EQ(Owner(kNew), kOtherMapper) << "its own mapper lives, and does not get it back";
  AnswerFusion(Propose(*task));
  Go(5);
  EXPECT_EQ(Owner(kOthers), kOtherMapper);
  EXPECT_EQ(atlas_.TrackersIn(kOthers, now_).size(), 2u);
}

TEST_F(MapJoinerTest, TheLargerMapOfTheRobotThatSawItStays) {
  StartInNewMap(60, 130);
  StartOtherRobot(100);
  SeeOverlap(3, kNew, kOthers);
  EXPECT_THAT(Commands(CommandKind::kActivateMap), IsEmpty()) << "another robot is in it: no switch";
  EXPECT_EQ(Owner(kOthers), kMapper);
  const auto task = NextFusion();
  ASSERT_TRUE(task);
  EXPECT_EQ(task->map, kNew);
  EXPECT_EQ(task->other, kOthers);
  // What the other robot sees meanwhile adds nothing.
  EXPECT_FALSE(joiner_.WantsOverlap(4, kOthers, kNew, now_));
}

TEST_F(MapJoinerTest, ARobotSwitchesWhileAnotherFuses) {
  StartInNewMap(60, 60);
  StartOtherRobot(10);
  const MapId third(4, 11, 2);
  Ask(kOtherTracker, "new_map", third, kOthers);
  Track(kOtherTracker, third);
  atlas_.OnSize(third, 5);
  SeeOverlap(4, third, kOthers);
  SeeOverlap(3, kNew, kOld);
  EXPECT_EQ(joiner_.num_open(), 2u);
  EXPECT_FALSE(joiner_.WantsOverlap(3, kNew, kOthers, now_));
}

TEST_F(MapJoinerTest, AUserOrdersASwitchAlongTheLinks) {
  StartInNewMap(60, 10);
  EXPECT_THAT(joiner_.Order(Order(1), 9, kOld, now_).error().message, HasSubstr("robot 9 has no tracker"));
  EXPECT_THAT(joiner_.Order(Order(2), 3, kOthers, now_).error().message, HasSubstr("not known"));
  EXPECT_THAT(joiner_.Order(Order(3), 3, kNew, now_).error().message, HasSubstr("already"));
  ASSERT_TRUE(joiner_.Order(Order(4), 3, kOld, now_).ok());
  Collect();
  EXPECT_FALSE(Commands(CommandKind::kActivateMap)[0].other.IsValid())
      << "nobody knows where the two lie to each other";
  EXPECT_THAT(joiner_.Order(Order(5), 3, kOld, now_).error().message, HasSubstr("under way"));
  EXPECT_THAT(joiner_.TakeEndedOrders(), IsEmpty()) << "what is not done is not answered";
  Ask(kTracker, "refuse_map", kOld, MapId(), "not seen");
  const auto refused = joiner_.TakeEndedOrders();
  ASSERT_THAT(refused, SizeIs(1));
  EXPECT_EQ(refused[0].order.id, Order(4).id);
  EXPECT_EQ(refused[0].record.problem, "not seen");
  Ask(kTracker, "link_maps", kNew, kOld, "", OldFromNew().Inverse());
  ASSERT_TRUE(joiner_.Order(Order(6), 3, kOld, now_).ok());
  Collect();
  const Command second = Commands(CommandKind::kActivateMap).back();
  EXPECT_EQ(second.other, kNew);
  EXPECT_THAT(second.map_from_other, Sim3Near(OldFromNew(), kExact, 1e-9));
  Ask(kTracker, "enter_map", kOld, kNew, "", OldFromNew());
  const auto done = joiner_.TakeEndedOrders();
  ASSERT_THAT(done, SizeIs(1));
  EXPECT_EQ(done[0].order.id, Order(6).id);
  EXPECT_TRUE(done[0].record.is_done);
}

TEST_F(MapJoinerTest, AUserHearsWhatCameOfAFusion) {
  StartInNewMap(60, 10);
  ASSERT_TRUE(joiner_.OrderFusion(Order(1), Overlap(kNew, kOld), now_).ok());
  Collect();
  EXPECT_THAT(joiner_.OrderFusion(Order(2), Overlap(kNew, kOld), now_).error().message, HasSubstr("under way"));
  const MapCorrection correction = Propose(*NextFusion());
  EXPECT_THAT(joiner_.TakeEndedOrders(), IsEmpty());
  AnswerFusion(correction);
  const auto done = joiner_.TakeEndedOrders();
  ASSERT_THAT(done, SizeIs(1));
  EXPECT_EQ(done[0].order.id, Order(1).id);
  EXPECT_TRUE(done[0].record.is_done);
  EXPECT_EQ(done[0].record.map, kOld);
  EXPECT_EQ(done[0].record.other, kNew);
}

/// A fusion needs the overlap from the side that goes, whichever saw it.
TEST(ToLoopClosureTest, TurnsAnOverlapAround) {
  const TwoMaps maps;
  OverlapOptions options;
  options.consistent_rounds = 0;
  OverlapDetector detector(options);
  StageTimes times;
  const KeyFrameId current = maps.Second(8);
  const auto found = detector.Detect(maps.second, current, maps.second.keyframe(current).data->bow,
                                     {maps.FirstAsOther()}, nullptr, &times);
  ASSERT_TRUE(found.confirmed);
  const LoopClosure straight = ToLoopClosure(*found.confirmed, maps.first, maps.second);
  EXPECT_EQ(straight.current, current);
  EXPECT_EQ(straight.seen, found.confirmed->place.seen);
  const LoopClosure turned = ToLoopClosure(*found.confirmed, maps.second, maps.first);
  EXPECT_EQ(turned.current, straight.matched);
  EXPECT_EQ(turned.matched, current);
  EXPECT_THAT(turned.current_from_matched * straight.current_from_matched, Sim3Near(Sim3d(), kExact, 1e-9));
  ASSERT_EQ(turned.merges.size(), straight.merges.size());
  ASSERT_FALSE(turned.seen.empty());
  for (const auto& [feature, landmark] : turned.seen) {
    EXPECT_NE(maps.second.FindPoint(landmark), nullptr);
    EXPECT_TRUE(maps.first.keyframe(turned.current).landmarks[feature].IsValid());
  }
}

}  // namespace
}  // namespace portolan
