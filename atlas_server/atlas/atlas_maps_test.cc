// The atlas's decisions on many maps: which are dormant, where the trackers are, what is known of maps to each other.

#include <gmock/gmock.h>

#include "atlas/atlas_test_world.h"
#include "testing/matchers.h"

namespace portolan {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

constexpr PoseTolerance kExact{1e-9, 1e-9};

class AtlasMapsTest : public AtlasWorld {
 protected:
  void TellIdle(bool idle) {
    MapperState state;
    state.process = kMapper;
    state.idle = idle;
    atlas_.OnMapperState(state, now_);
  }
};

TEST_F(AtlasMapsTest, AMapThatTheTrackerLeftBecomesDormantInTheNextEpoch) {
  StartInNewMap(60, 1);
  EXPECT_EQ(EpochOf(kOld), 2u);
  EXPECT_EQ(owners_[kOld], kServer);
  EXPECT_FALSE(atlas_.IsActive(kOld, now_));
  EXPECT_TRUE(atlas_.IsActive(kNew, now_));
  EXPECT_EQ(atlas_.graph().ActivityOf(kOld, kNew), 1u);
  EXPECT_EQ(atlas_.num_takeovers(), 0u) << "nobody died";
  Go(20);
  EXPECT_THAT(commands_, IsEmpty());
}

TEST_F(AtlasMapsTest, ItIsLeftToAMapperThatHasKeyFramesOfItInItsQueue) {
  StartInNewMap(60, 1);
  TellIdle(false);
  Track(kTracker, kOld);
  Go(1);
  ASSERT_EQ(Owner(kOld), kMapper);
  for (int i = 0; i < 16; ++i) {  // 4 s
    TellIdle(false);
    Go(0.25);
  }
  EXPECT_EQ(Owner(kNew), kMapper);
  TellIdle(true);
  Go(0.25);
  EXPECT_EQ(Owner(kNew), kServer);
}

TEST_F(AtlasMapsTest, AMapperThatNeverRestsLosesItAtLast) {
  StartInNewMap(60, 1);
  Track(kTracker, kOld);
  TellIdle(false);
  Go(Atlas::kDormantAtLastS - 0.5);
  EXPECT_EQ(Owner(kNew), kMapper);
  Go(1);
  EXPECT_EQ(Owner(kNew), kServer);
}

TEST_F(AtlasMapsTest, AMapThatATrackerWaitsForIsNotDormant) {
  StartInNewMap(60, 1);
  const MapId third(3, 10, 3);
  Ask(kTracker, "new_map", third, kNew);
  Go(10);
  EXPECT_EQ(Owner(third), kMapper);
  EXPECT_EQ(Owner(kNew), kMapper);
  Track(kTracker, third);
  Go(3);
  EXPECT_EQ(Owner(third), kMapper);
  EXPECT_EQ(Owner(kNew), kServer);
}

TEST_F(AtlasMapsTest, ADeadTrackersMapIsDormantAfterAWhile) {
  StartInNewMap(60, 1);
  Die(kTracker);
  Go(Atlas::kGoneS - 0.5);
  EXPECT_EQ(Owner(kNew), kMapper);
  Go(2.5);
  EXPECT_EQ(Owner(kNew), kServer);
  Live(kTracker, "frontend_tracker", kNew, 1);  // it only slept
  Go(0.5);
  EXPECT_EQ(Owner(kNew), kMapper);
  EXPECT_EQ(EpochOf(kNew), 3u);
}

/// It keeps the map when a mapper of the dead robot comes back.
TEST_F(AtlasMapsTest, ADeadOwnersMapPassesToTheMapperOfARobotThatIsInIt) {
  StartInNewMap(60, 60);
  StartOtherRobot(10);
  Ask(kOtherTracker, "enter_map", kNew, kOthers, "", OldFromNew());
  Track(kOtherTracker, kNew);
  Go(3);
  ASSERT_EQ(Owner(kNew), kMapper) << "one owner for both robots";
  for (const ProcessId process : {kMapper, kTracker}) Die(process);
  Go(Atlas::kAliveS);
  EXPECT_EQ(Owner(kNew), kMapper);
  Go(0.25);
  EXPECT_EQ(Owner(kNew), kOtherMapper);
  EXPECT_EQ(EpochOf(kNew), 2u);
  EXPECT_EQ(owners_[kNew], kOtherMapper) << "it is stored";
  EXPECT_EQ(atlas_.num_takeovers(), 1u);

  const ProcessId new_tracker(3, 12, 1), new_mapper(3, 22, 1);
  Live(new_mapper, "backend_mapper");
  EXPECT_TRUE(ReplyTo(Ask(new_mapper, "register_mapper")).ok);
  Track(new_tracker, kNew);
  Go(Atlas::kGoneS + 1);
  EXPECT_EQ(Owner(kNew), kOtherMapper);
  EXPECT_EQ(EpochOf(kNew), 2u);
}

TEST_F(AtlasMapsTest, ATrackerThatEntersAMapHasItGrantedAndLeavesTheOther) {
  StartInNewMap(60, 60);
  EXPECT_TRUE(ReplyTo(Ask(kTracker, "enter_map", kOld, kNew, "", OldFromNew())).ok);
  EXPECT_EQ(Owner(kOld), kMapper);
  EXPECT_EQ(EpochOf(kOld), 3u);
  EXPECT_EQ(atlas_.graph().ActivityOf(kOld, kNew), 2u);
  const auto links = Commands(CommandKind::kLinkMaps);
  ASSERT_THAT(links, SizeIs(1)) << "it knows where the two lie to each other, which nobody did";
  EXPECT_THAT(links[0].map_from_other, Sim3Near(OldFromNew(), kExact, 1e-9));
  Track(kTracker, kOld);
  Go(3);
  EXPECT_EQ(Owner(kNew), kServer);
}

TEST_F(AtlasMapsTest, AnEntryMeasuresALinkAnewButThoseOfNewMaps) {
  for (const MapGraph::Origin origin : {MapGraph::Origin::kOverlap, MapGraph::Origin::kNewMap}) {
    atlas_ = Atlas(kServer, now_);
    StartInNewMap(60, 60);
    atlas_.LinkMaps({kOld, kNew, Sim3d(1.4, Eigen::Quaterniond::Identity(), {1, 1, 1}), origin});
    Ask(kTracker, "enter_map", kOld, kNew, "", OldFromNew());
    const auto link = atlas_.graph().FindLink(kOld, kNew);
    EXPECT_EQ(link->origin, origin);
    EXPECT_NEAR(link->map_from_other.scale, origin == MapGraph::Origin::kOverlap ? OldFromNew().scale : 1.4, 1e-12);
    living_.clear();
  }
}

TEST_F(AtlasMapsTest, AnEntryWithoutASimilarityIsNoLink) {
  StartInNewMap(60, 60);
  EXPECT_TRUE(ReplyTo(Ask(kTracker, "enter_map", kOld, kNew)).ok);
  EXPECT_EQ(atlas_.graph().num_links(), 0u);
  const Reply unknown = ReplyTo(Ask(kTracker, "enter_map", MapId(9, 9, 9)));
  EXPECT_FALSE(unknown.ok);
  EXPECT_THAT(unknown.reason, HasSubstr("9.000009.9 is not known"));
}

TEST_F(AtlasMapsTest, LinksArePublishedOnceAndKept) {
  StartInNewMap(60, 10);
  Request request;
  request.sender = kTracker;
  request.kind = "link_maps";
  request.map = kNew;
  request.other = kOld;
  request.map_from_other = OldFromNew().Inverse();
  const RequestId id = Ask(request);
  EXPECT_TRUE(ReplyTo(id).ok);
  request.id = id;
  atlas_.OnRequest(request, now_);  // repeated
  Collect();
  ASSERT_THAT(Commands(CommandKind::kLinkMaps), SizeIs(1));
  const auto link = atlas_.graph().FindLink(kOld, kNew);
  ASSERT_TRUE(link);
  EXPECT_EQ(link->origin, MapGraph::Origin::kNewMap);
  EXPECT_THAT(link->map_from_other, Sim3Near(OldFromNew(), kExact, 1e-9));
  EXPECT_FALSE(ReplyTo(Ask(kTracker, "link_maps", kNew, kNew)).ok);
}

TEST_F(AtlasMapsTest, ANewMapsReplyTellsHowManyMapsHaveKeyFrames) {
  StartInNewMap(60, 0);
  EXPECT_EQ(ReplyTo(Ask(kTracker, "new_map", MapId(3, 10, 3))).text, "1");
  atlas_.OnSize(kNew, 2);
  EXPECT_EQ(ReplyTo(Ask(kTracker, "new_map", MapId(3, 10, 4))).text, "2");
}

TEST_F(AtlasMapsTest, ForwardsToTheRobotThatIsMeant) {
  StartInNewMap(60, 1);
  const ProcessId tool(0, 77, 1);
  EXPECT_TRUE(ReplyTo(Ask(tool, "pause")).ok) << "there is but one robot";
  ASSERT_THAT(Commands(CommandKind::kPause), SizeIs(1));
  EXPECT_EQ(Commands(CommandKind::kPause)[0].robot, 3);
  StartOtherRobot(5);
  EXPECT_THAT(ReasonAgainst(Ask(tool, "resume")), HasSubstr("2 robots"));
  EXPECT_TRUE(ReplyTo(Ask(tool, "localize_only", MapId(), MapId(), "4")).ok);
  EXPECT_EQ(Commands(CommandKind::kLocalizeOnly)[0].robot, 4);
  EXPECT_THAT(ReasonAgainst(Ask(tool, "map_again", MapId(), MapId(), "5")), HasSubstr("robot 5 has no tracker"));
  EXPECT_THAT(ReasonAgainst(Ask(tool, "start_map", MapId(), MapId(), "4x")), HasSubstr("'4x' is no robot's number"));
}

TEST_F(AtlasMapsTest, WhatATrackerWouldNotDoIsRefused) {
  StartInNewMap(60, 1);
  const ProcessId tool(0, 77, 1);
  const auto ask = [&](const std::string& kind, const std::vector<std::pair<std::string, double>>& figures) {
    living_[kTracker].figures = figures;
    atlas_.OnStatus(living_[kTracker], now_);
    return Ask(tool, kind);
  };
  EXPECT_THAT(ReasonAgainst(ask("start_map", {{"localization_only", 1}})), HasSubstr("localises only"));
  EXPECT_THAT(ReasonAgainst(ask("pause", {{"takes_orders", 0}})), HasSubstr("has not begun, or is at its end"));
  EXPECT_TRUE(ReplyTo(ask("resume", {{"localization_only", 1}, {"takes_orders", 1}})).ok);
  EXPECT_TRUE(ReplyTo(ask("start_map", {{"localization_only", 0}, {"takes_orders", 1}})).ok);
  EXPECT_THAT(Commands(CommandKind::kPause), IsEmpty());
  EXPECT_THAT(Commands(CommandKind::kNewMap), SizeIs(1));
  living_[kTracker].figures = {{"paused", 1}};
  atlas_.OnStatus(living_[kTracker], now_);
  EXPECT_THAT(atlas_.WouldObey(CommandKind::kActivateMap, 3, now_).error().message, HasSubstr("paused"));
  Track(kTracker, MapId());
  EXPECT_THAT(ReasonAgainst(Ask(tool, "start_map")), HasSubstr("in no map"));
}

/// Discovered here later than by whoever orders; the order is repeated meanwhile, and carried out once.
TEST_F(AtlasMapsTest, AnOrderWaitsForWhomItIsMeant) {
  StartInNewMap(60, 1);
  Request order;
  order.id = RequestId(0, 77, 1);
  order.sender = ProcessId(0, 77, 1);
  order.kind = "global_ba";
  order.map = kNew;
  for (int i = 0; i < 3; ++i) {
    atlas_.OnRequest(order, now_);
    Go(1);
  }
  EXPECT_THAT(replies_[order.id], IsEmpty());
  Live(ProcessId(3, 30, 1), "loop_closer");
  Go(1);
  EXPECT_TRUE(ReplyTo(order.id).ok);
  Go(Atlas::kHearS);
  EXPECT_THAT(replies_[order.id], SizeIs(1));
  EXPECT_THAT(Commands(CommandKind::kAdjustMap), SizeIs(1));
}

TEST_F(AtlasMapsTest, GlobalBundleAdjustmentNeedsAMapWithAMapper) {
  StartInNewMap(60, 1);
  EXPECT_THAT(ReasonAgainst(Ask(kTracker, "global_ba", kNew)), HasSubstr("has no loop_closer"));
  Live(ProcessId(3, 30, 1), "loop_closer");
  Go(1);
  const Reply told = ReplyTo(Ask(kTracker, "global_ba", kNew));
  EXPECT_TRUE(told.ok) << told.reason;
  EXPECT_THAT(told.text, HasSubstr("loop_closer of robot 3"));
  ASSERT_THAT(Commands(CommandKind::kAdjustMap), SizeIs(1));
  EXPECT_EQ(Commands(CommandKind::kAdjustMap)[0].map, kNew);
  EXPECT_THAT(ReasonAgainst(Ask(kTracker, "global_ba", kOld)), HasSubstr("dormant"));
  EXPECT_THAT(ReasonAgainst(Ask(kTracker, "global_ba", kOthers)), HasSubstr("not known"));
}

TEST_F(AtlasMapsTest, DeletesWhatNobodyUsesAndIgnoresWhatComesLate) {
  StartInNewMap(60, 1);
  EXPECT_THAT(ReplyTo(Ask(kTracker, "delete_map", kNew)).reason, HasSubstr("in use"));
  const Epoch granted = atlas_.maps().at(kOld).epoch;
  EXPECT_GT(granted, 0u);
  EXPECT_TRUE(ReplyTo(Ask(kTracker, "delete_map", kOld)).ok);
  EXPECT_THAT(Commands(CommandKind::kForgetMap), SizeIs(1));
  EXPECT_THAT(atlas_.TakeDeleted(), ::testing::ElementsAre(kOld));
  atlas_.OnEpoch(kOld, 1);
  atlas_.OnSize(kOld, 60);
  Live(kMapper, "backend_mapper", kOld, 1);
  Go(3);
  EXPECT_EQ(atlas_.maps().count(kOld), 0u);
  EXPECT_EQ(atlas_.SizeOf(kOld), 0u);
  EXPECT_FALSE(ReplyTo(Ask(kTracker, "delete_map", kOld)).ok);
  // It comes back above all epochs that were granted.
  const Epoch last = atlas_.DeletedEpoch(kOld);
  EXPECT_EQ(last, granted);
  atlas_.Adopt(kOld, last + 1);
  EXPECT_EQ(atlas_.maps().at(kOld).epoch, last + 2);
  EXPECT_EQ(atlas_.DeletedEpoch(kOld), 0u);
}

TEST_F(AtlasMapsTest, ATrackerThatMissedAFusionIsToldByTheNextAtlasServer) {
  MapGraph graph;
  graph.AddMap(kOld);
  graph.AddMap(kNew);
  graph.Merge(kOld, kNew, OldFromNew());
  atlas_.Restore({{kOld, 3, 4, kMapper}}, graph);
  Live(kMapper, "backend_mapper", kOld, 4);
  Live(kTracker, "frontend_tracker", kNew, 3);
  Go(5);
  const auto fusions = Commands(CommandKind::kFuseMaps);
  ASSERT_THAT(fusions, SizeIs(1));
  EXPECT_EQ(fusions[0].map, kOld);
  EXPECT_EQ(fusions[0].other, kNew);
  EXPECT_THAT(fusions[0].map_from_other, Sim3Near(OldFromNew(), kExact, 1e-9));
  EXPECT_EQ(Owner(kOld), kMapper) << "who is in what went into a map is in that";
  EXPECT_EQ(atlas_.maps().count(kNew), 0u);
  EXPECT_TRUE(ReplyTo(Ask(kTracker, "enter_map", kNew)).ok);
  EXPECT_EQ(atlas_.MapOf(kTracker), kOld);
}

/// The atlas_server dies after it told the tracker to switch; the next one has the store alone.
TEST_F(AtlasMapsTest, ASwitchGoesOnUnderTheNextAtlasServer) {
  StartInNewMap(60, 60);
  joiner_.OnOverlap(3, Overlap(kNew, kOld), now_);
  Collect();
  ASSERT_THAT(Commands(CommandKind::kActivateMap), SizeIs(1));
  std::vector<Atlas::Ownership> stored;
  for (const auto& [id, ownership] : atlas_.maps()) stored.push_back(ownership);
  const MapGraph graph = MapGraph(atlas_.graph().state());
  atlas_ = Atlas(kServer, now_);
  joiner_ = MapJoiner(kServer, JoinOptions(), &atlas_);
  atlas_.Restore(stored, graph);
  commands_.clear();
  Live(kMapper, "backend_mapper", kNew, 1);
  const RequestId entered = Ask(kTracker, "enter_map", kOld, kNew, "", OldFromNew());
  Track(kTracker, kOld);
  Go(Atlas::kGoneS + 4);  // for so long the map that nobody is in may have a tracker that was not heard of yet
  EXPECT_TRUE(ReplyTo(entered).ok);
  EXPECT_EQ(Owner(kOld), kMapper);
  EXPECT_EQ(EpochOf(kOld), 3u);
  EXPECT_EQ(Owner(kNew), kServer);
  EXPECT_EQ(atlas_.graph().ActivityOf(kOld, kNew), 2u);
}

/// It dies while a fusion's maps are with one mapper: nothing is lost, and the fusion is to be found again.
TEST_F(AtlasMapsTest, AFusionThatWasUnderWayIsForgottenByTheNextAtlasServer) {
  StartInNewMap(60, 20);
  joiner_.OnOverlap(3, Overlap(kNew, kOld), now_);
  Collect();
  ASSERT_EQ(Owner(kOld), kMapper);
  std::vector<Atlas::Ownership> stored;
  for (const auto& [id, ownership] : atlas_.maps()) stored.push_back(ownership);
  const MapGraph graph = MapGraph(atlas_.graph().state());
  atlas_ = Atlas(kServer, now_);
  joiner_ = MapJoiner(kServer, JoinOptions(), &atlas_);
  atlas_.Restore(stored, graph);
  atlas_.OnSize(kOld, 60);
  atlas_.OnSize(kNew, 20);
  Live(kMapper, "backend_mapper", kOld, 3);
  Go(Atlas::kGoneS + 4);
  EXPECT_EQ(Owner(kNew), kMapper);
  EXPECT_EQ(EpochOf(kNew), 1u) << "nobody took it from its owner";
  EXPECT_EQ(Owner(kOld), kServer);
  EXPECT_EQ(EpochOf(kOld), 4u);
  EXPECT_TRUE(joiner_.WantsOverlap(3, kNew, kOld, now_));
}

}  // namespace
}  // namespace portolan
