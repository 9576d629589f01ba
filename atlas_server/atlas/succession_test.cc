#include "atlas/succession.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace portolan {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;

const ProcessId kServer(0, 1, 1), kTracker(3, 10, 1), kMapperA(3, 20, 1), kMapperB(3, 30, 1), kLoopA(3, 40, 1),
    kLoopB(3, 50, 1), kServerB(0, 60, 1), kTool(3, 70, 1);
const MapId kMap(3, 10, 1), kNextMap(3, 10, 2);

/// An atlas with robot 3 in a map, a clock, and processes that tell that they live whenever the time goes on.
class SuccessionTest : public ::testing::Test {
 protected:
  SuccessionTest() {
    Go(2);
    Live(kTracker, "frontend_tracker", "tracking", kMap);
    Live(kMapperA, "backend_mapper", "mapping", kMap);
    Report(kMapperA, "register_mapper");
    Report(kTracker, "new_map", kMap);
    Live(kLoopA, "loop_closer", "following", kMap);
    Go(3);
    commands_.clear();
  }
  void Go(double seconds) {
    for (const double end = now_ + seconds; now_ + 1e-9 < end;) {
      now_ += 0.25;
      for (const auto& [process, status] : living_) atlas_.OnStatus(status, now_);
      atlas_.OnTick(now_);
      HandOrdersOver();
      succession_.OnTick(now_);
    }
    Collect();
  }
  void Live(ProcessId process, const std::string& role, const std::string& state, MapId map = MapId(), double lag = 0) {
    ProcessStatus& status = living_[process];
    status.process = process;
    status.role = role;
    status.host = "rack-2";
    status.state = state;
    status.map = map;
    status.epoch = map.IsValid() ? 1 : 0;
    status.revision = map.IsValid() ? 88 : 0;
    status.figures = {{"lag", lag}};
    atlas_.OnStatus(status, now_);
  }
  void StandBy(ProcessId process, const std::string& role, double lag = 0) {
    Live(process, role, kStandbyState, kMap, lag);
  }
  void Die(ProcessId process) { living_.erase(process); }

  RequestId Report(ProcessId sender, const std::string& kind, MapId map = MapId(), const std::string& argument = "") {
    Request request;
    request.id = ids_.Next();
    request.sender = sender;
    request.kind = kind;
    request.map = map;
    request.argument = argument;
    if (kind == "holds_map" || kind == "drained") {
      succession_.OnReport(request, now_);
    } else {
      atlas_.OnRequest(request, now_);
    }
    Collect();
    return request.id;
  }
  void Hold(ProcessId process, Epoch epoch, Revision revision, uint64_t hash = 0xabc, MapId map = kMap) {
    Report(process, "holds_map", map, ToText({map, epoch, revision, 34, 2045, hash}));
  }
  RequestId Swap(const std::string& role) {
    const RequestId id = Report(kTool, "swap", MapId(), role);
    HandOrdersOver();
    Collect();
    return id;
  }
  void HandOrdersOver() {
    for (const Request& order : atlas_.TakeOrders()) succession_.OnOrder(order, now_);
  }
  void Collect() {
    static_cast<void>(atlas_.TakeGrants());
    for (const Command& command : atlas_.TakeCommands()) commands_.push_back(command);
    for (const Reply& reply : atlas_.TakeReplies()) replies_[reply.id].push_back(reply);
  }
  Reply ReplyTo(RequestId id) {
    EXPECT_EQ(replies_[id].size(), 1u);
    return replies_[id].empty() ? Reply() : replies_[id].back();
  }
  void ExpectRefused(RequestId id, const std::string& reason) {
    const Reply reply = ReplyTo(id);
    EXPECT_FALSE(reply.ok);
    EXPECT_THAT(reply.reason, HasSubstr(reason));
  }
  /// Not at once, since what changes that may be under way.
  void ExpectRefusedAtLast(RequestId id, const std::string& reason) {
    EXPECT_THAT(replies_[id], IsEmpty());
    Go(Atlas::kHearS + 0.5);
    ExpectRefused(id, reason);
  }
  /// In words, in order.
  std::vector<std::string> Said() const {
    std::vector<std::string> said;
    for (const Command& command : commands_) {
      const char* kind = command.kind == CommandKind::kDrain            ? "drain "
                         : command.kind == CommandKind::kGrantOwnership ? "grant "
                                                                        : "appoint ";
      said.push_back(kind + ToString(command.owner));
    }
    return said;
  }
  const std::string drain_a_ = "drain " + ToString(kMapperA), grant_b_ = "grant " + ToString(kMapperB),
                    appoint_a_ = "appoint " + ToString(kMapperA), appoint_b_ = "appoint " + ToString(kMapperB);

  double now_ = 100;
  Atlas atlas_{kServer, 100};
  std::map<MapId, HeldMap> held_;  // by the atlas_server itself
  Succession succession_{kServer, &atlas_, [this](MapId map) {
                           const auto held = held_.find(map);
                           return held == held_.end() ? std::nullopt : std::optional(held->second);
                         }};
  std::map<ProcessId, ProcessStatus> living_;
  IdMinter<RequestId> ids_{3, 7};
  std::vector<Command> commands_;
  std::map<RequestId, std::vector<Reply>> replies_;
};

TEST_F(SuccessionTest, AMapperDrainsThenItsMapsPassOnThenItLeaves) {
  StandBy(kMapperB, "backend_mapper");
  const RequestId swap = Swap("backend_mapper");
  EXPECT_EQ(Said(), std::vector<std::string>({drain_a_}));
  Hold(kMapperB, 1, 88);
  Hold(kMapperA, 1, 90);
  Report(kMapperA, "drained");
  EXPECT_EQ(Said().size(), 1u) << "the standby is two deltas behind";
  Hold(kMapperB, 1, 90);
  EXPECT_EQ(Said(), std::vector<std::string>({drain_a_, grant_b_, appoint_b_}));
  EXPECT_EQ(commands_[1].map, kMap);
  EXPECT_EQ(commands_[1].epoch, 2u);
  EXPECT_THAT(replies_[swap], IsEmpty()) << "it has not taken over";
  Hold(kMapperB, 2, 90);
  const Reply reply = ReplyTo(swap);
  EXPECT_TRUE(reply.ok) << reply.reason;
  EXPECT_THAT(reply.text, HasSubstr("\"same\":true"));
  EXPECT_THAT(reply.text, HasSubstr(ToString(kMapperB)));
  EXPECT_EQ(atlas_.HolderOf("backend_mapper", 3, now_), kMapperB);
  EXPECT_EQ(succession_.num_swaps(), 1u);
}

TEST_F(SuccessionTest, AllMapsOfTheMapperPassOnAndNewOnesWait) {
  StandBy(kMapperB, "backend_mapper");
  Swap("backend_mapper");
  Report(kTracker, "new_map", kNextMap);
  EXPECT_EQ(Said().size(), 1u) << "not to one that leaves";
  Hold(kMapperA, 1, 90);
  Hold(kMapperB, 1, 90);
  Report(kMapperA, "drained");
  Go(0.5);
  EXPECT_EQ(Said(), std::vector<std::string>({drain_a_, grant_b_, appoint_b_, grant_b_}));
  EXPECT_EQ(commands_[3].map, kNextMap);
  EXPECT_EQ(commands_[3].epoch, 1u);
}

TEST_F(SuccessionTest, AMapThatHasNotBegunPassesOnUnseen) {
  Report(kTracker, "new_map", kNextMap);
  commands_.clear();
  StandBy(kMapperB, "backend_mapper");
  const RequestId swap = Swap("backend_mapper");
  Hold(kMapperA, 1, 90);
  Hold(kMapperA, 1, 0, 1, kNextMap);
  Hold(kMapperB, 1, 90);
  Report(kMapperA, "drained");
  EXPECT_EQ(Said(), std::vector<std::string>({drain_a_, grant_b_, grant_b_, appoint_b_}));
  Hold(kMapperB, 2, 90);
  EXPECT_TRUE(ReplyTo(swap).ok);
}

/// It was started a moment ago, and is discovered here later than by whoever orders.
TEST_F(SuccessionTest, AnOrderWaitsForTheStandby) {
  const RequestId swap = Swap("backend_mapper");
  Go(Atlas::kHearS - 1);
  EXPECT_THAT(replies_[swap], IsEmpty());
  StandBy(kMapperB, "backend_mapper");
  Go(0.5);
  EXPECT_EQ(Said(), std::vector<std::string>({drain_a_}));
}

TEST_F(SuccessionTest, RefusesWhatCannotBe) {
  ExpectRefusedAtLast(Swap("backend_mapper"), "no standby for the backend_mapper of robot 3");
  ExpectRefusedAtLast(Swap("frontend_tracker"), "expected backend_mapper, loop_closer or atlas_server");
  ExpectRefusedAtLast(Swap("atlas_server"), "no standby for the atlas_server");
  StandBy(kMapperB, "backend_mapper", 200);
  ExpectRefusedAtLast(Swap("backend_mapper"), "200 revisions behind");
  Live(kMapperB, "backend_mapper", kStandbyState, kNextMap);
  ExpectRefusedAtLast(Swap("backend_mapper"), "follows map " + ToString(kNextMap));
  StandBy(kMapperB, "backend_mapper");
  atlas_.Hold(kMap, kMapperA, now_);
  ExpectRefusedAtLast(Swap("backend_mapper"), "is being fused");
  atlas_.Release(kMap);
  Swap("backend_mapper");
  ExpectRefusedAtLast(Swap("backend_mapper"), "under way");
  EXPECT_EQ(Said(), std::vector<std::string>({drain_a_}));
}

TEST_F(SuccessionTest, OneThatDoesNotDrainGoesOn) {
  StandBy(kMapperB, "backend_mapper");
  const RequestId swap = Swap("backend_mapper");
  Hold(kMapperB, 1, 88);
  Go(Succession::kDrainS + 1);
  ExpectRefused(swap, "did not end what it had begun");
  EXPECT_EQ(Said(), std::vector<std::string>({drain_a_, appoint_a_}));
  Report(kTracker, "new_map", kNextMap);
  EXPECT_EQ(Said().back(), "grant " + ToString(kMapperA)) << "new maps are its again";
}

TEST_F(SuccessionTest, AStandbyWithAnotherMapDoesNotGetIt) {
  StandBy(kMapperB, "backend_mapper");
  const RequestId swap = Swap("backend_mapper");
  Hold(kMapperA, 1, 90, 0xabc);
  Hold(kMapperB, 1, 90, 0xdef);
  Report(kMapperA, "drained");
  ExpectRefused(swap, "holds another map");
  EXPECT_EQ(Said(), std::vector<std::string>({drain_a_, appoint_a_}));
}

TEST_F(SuccessionTest, AStandbyThatDiesChangesNothing) {
  StandBy(kMapperB, "backend_mapper");
  const RequestId swap = Swap("backend_mapper");
  Die(kMapperB);
  Go(Atlas::kAliveS + 0.5);
  ExpectRefused(swap, "the standby died");
  EXPECT_EQ(Said(), std::vector<std::string>({drain_a_, appoint_a_}));
}

TEST_F(SuccessionTest, AMapperThatDiesWhileItDrainsIsReplaced) {
  Report(kMapperB, "register_mapper", MapId(), kStandbyState);
  StandBy(kMapperB, "backend_mapper");
  const RequestId swap = Swap("backend_mapper");
  Die(kMapperA);
  Go(Atlas::kAliveS + 0.5);
  ExpectRefused(swap, "died while it drained");
  EXPECT_EQ(Said(), std::vector<std::string>({drain_a_, appoint_b_, grant_b_}));
}

TEST_F(SuccessionTest, OneThatDoesNotSayThatItTookOverIsNamed) {
  StandBy(kMapperB, "backend_mapper");
  const RequestId swap = Swap("backend_mapper");
  Hold(kMapperA, 1, 90);
  Hold(kMapperB, 1, 90);
  Report(kMapperA, "drained");
  Go(Succession::kTakeOverS + 1);
  ExpectRefused(swap, ToString(kMapperB));
}

TEST_F(SuccessionTest, AStandbyTakesThePlaceOfAMapperThatDied) {
  Report(kMapperB, "register_mapper", MapId(), kStandbyState);
  StandBy(kMapperB, "backend_mapper");
  Die(kMapperA);
  Go(Atlas::kAliveS + 0.5);
  EXPECT_EQ(Said(), std::vector<std::string>({appoint_b_, grant_b_}));
}

/// An atlas_server that came later: nobody registers with it again.
TEST_F(SuccessionTest, AStandbyIsKnownByItsStatus) {
  StandBy(kMapperB, "backend_mapper");
  Go(5);
  EXPECT_THAT(Said(), IsEmpty());
  Die(kMapperA);
  Go(Atlas::kAliveS + 0.5);
  EXPECT_EQ(Said(), std::vector<std::string>({appoint_b_, grant_b_}));
}

TEST_F(SuccessionTest, ALoopCloserLeavesOnceTheStandbyIsAsFar) {
  StandBy(kLoopB, "loop_closer");
  const RequestId swap = Swap("loop_closer");
  Hold(kLoopB, 1, 89);
  Report(kLoopA, "drained");
  EXPECT_EQ(Said(), std::vector<std::string>({"drain " + ToString(kLoopA), "appoint " + ToString(kLoopB)}));
  EXPECT_TRUE(ReplyTo(swap).ok);
}

TEST_F(SuccessionTest, ALoopCloserWaitsForAStandbyThatIsBehind) {
  StandBy(kLoopB, "loop_closer");
  const RequestId swap = Swap("loop_closer");
  Hold(kLoopA, 1, 90);
  Hold(kLoopB, 1, 89);
  Report(kLoopA, "drained");
  EXPECT_EQ(Said().size(), 1u);
  Hold(kLoopB, 1, 95);
  EXPECT_EQ(Said().size(), 2u);
  EXPECT_EQ(commands_[1].kind, CommandKind::kAppointLoopCloser);
  EXPECT_EQ(commands_[1].robot, 3);
  EXPECT_TRUE(ReplyTo(swap).ok);
}

TEST_F(SuccessionTest, ALoopCloserThatDiedIsReplacedAndTheAppointmentRepeatedUntilItShows) {
  StandBy(kLoopB, "loop_closer");
  Go(5);
  EXPECT_THAT(Said(), IsEmpty());
  Die(kLoopA);
  Go(Atlas::kAliveS + 0.5);
  EXPECT_EQ(Said(), std::vector<std::string>({"appoint " + ToString(kLoopB)}));
  EXPECT_EQ(succession_.num_promotions(), 1u);
  Go(Succession::kAppointAgainS);
  EXPECT_EQ(Said().size(), 2u);
  Live(kLoopB, "loop_closer", "following", kMap);
  Go(5);
  EXPECT_EQ(Said().size(), 2u);
  EXPECT_EQ(succession_.num_promotions(), 1u);
}

class AtlasSwapTest : public SuccessionTest {
 protected:
  AtlasSwapTest() {
    held_[kMap] = {kMap, 1, 90, 34, 2045, 0xabc};
    held_[kNextMap] = {kNextMap, 1, 7, 34, 2045, 0xabc};
    atlas_.Adopt(kNextMap, 1);
    Collect();
    commands_.clear();
    Live(kServerB, "atlas_server", kStandbyState);
  }
};

TEST_F(AtlasSwapTest, ItLeavesOnceTheStandbyHoldsAllMaps) {
  const RequestId swap = Swap("atlas_server");
  Hold(kServerB, 1, 90);
  EXPECT_FALSE(succession_.MayLeave()) << "it lacks a dormant map";
  held_[kMap].revision = 95;  // goes on meanwhile
  Hold(kServerB, 1, 7, 0xabc, kNextMap);
  ASSERT_TRUE(succession_.MayLeave());
  EXPECT_THAT(replies_[swap], IsEmpty()) << "it has to be stored first";
  succession_.Leave(now_);
  Collect();
  EXPECT_EQ(Said(), std::vector<std::string>({"drain " + ToString(kServer), "appoint " + ToString(kServerB)}));
  EXPECT_EQ(commands_[1].kind, CommandKind::kAppointAtlasServer);
  EXPECT_TRUE(ReplyTo(swap).ok);
}

TEST_F(AtlasSwapTest, DormantMapsAreInAFileThatBothHave) {
  living_[kServerB].figures = {{"waits_for_store", 1}};
  atlas_.OnStatus(living_[kServerB], now_);
  Swap("atlas_server");
  EXPECT_FALSE(succession_.MayLeave());
  Hold(kServerB, 1, 90);
  EXPECT_TRUE(succession_.MayLeave());
}

TEST_F(AtlasSwapTest, ItStaysWhereItsMapsCannotBeStored) {
  const RequestId swap = Swap("atlas_server");
  Hold(kServerB, 1, 90);
  Hold(kServerB, 1, 7, 0xabc, kNextMap);
  ASSERT_TRUE(succession_.MayLeave());
  succession_.Stay("the disk is full");
  Collect();
  ExpectRefused(swap, "the disk is full");
  EXPECT_EQ(Said().back(), "appoint " + ToString(kServer));
}

TEST_F(AtlasSwapTest, AStandbyWithoutAllMapsIsRefusedOrGivenUp) {
  living_[kServerB].figures = {{"maps_missing", 2}};
  atlas_.OnStatus(living_[kServerB], now_);
  ExpectRefusedAtLast(Swap("atlas_server"), "lacks 2 maps");
  living_[kServerB].figures = {};
  atlas_.OnStatus(living_[kServerB], now_);
  const RequestId swap = Swap("atlas_server");
  Hold(kServerB, 1, 90);
  Go(Succession::kDrainS + 1);
  ExpectRefused(swap, "did not catch up");
}

TEST(StandbyAtlas, HearsAndSaysNothingUntilItIsPromoted) {
  Atlas atlas(kServerB, 100);
  atlas.StandBy();
  Request request;
  request.id = RequestId(3, 7, 1);
  request.sender = kMapperA;
  request.kind = "register_mapper";
  ProcessStatus mapper;
  mapper.process = kMapperA;
  mapper.role = "backend_mapper";
  mapper.map = kMap;
  mapper.epoch = 2;
  ProcessStatus tracker;
  tracker.process = kTracker;
  tracker.role = "frontend_tracker";
  tracker.map = kMap;
  double now = 100;
  const auto go = [&](double seconds) {
    for (const double end = now + seconds; now < end; now += 0.25) {
      atlas.OnStatus(mapper, now);
      atlas.OnStatus(tracker, now);
      atlas.OnTick(now);
    }
  };
  atlas.Follow({{kMap, 3, 2, kMapperA}, {kNextMap, 3, 4, kServer}});
  atlas.OnRequest(request, now);
  go(20);
  EXPECT_THAT(atlas.TakeReplies(), IsEmpty());
  EXPECT_THAT(atlas.TakeCommands(), IsEmpty());
  atlas.Promote(now);
  go(1);
  EXPECT_THAT(atlas.TakeReplies(), IsEmpty()) << "the other has answered";
  EXPECT_EQ(atlas.HolderOf("backend_mapper", 3, now), kMapperA);
  EXPECT_EQ(atlas.maps().at(kMap).owner, kMapperA);
  EXPECT_EQ(atlas.maps().at(kMap).epoch, 2u) << "nobody took it from its owner";
  go(5);
  EXPECT_EQ(atlas.maps().at(kNextMap).owner, kServerB) << "the other's dormant maps are its own";
  EXPECT_EQ(atlas.maps().at(kNextMap).epoch, 5u);
}

TEST(StandbyAtlas, FollowsTheNewerWordAndDeletions) {
  Atlas atlas(kServerB, 100);
  atlas.StandBy();
  atlas.Follow({{kMap, 3, 2, kMapperB}});
  atlas.Follow({{kMap, 3, 1, kMapperA}});
  EXPECT_EQ(atlas.maps().at(kMap).owner, kMapperB);
  atlas.FollowDeletion(kMap);
  EXPECT_EQ(atlas.DeletedEpoch(kMap), 2u);
  atlas.Follow({{kMap, 3, 2, kMapperB}});
  EXPECT_EQ(atlas.maps().count(kMap), 0u) << "said before";
}

}  // namespace
}  // namespace portolan
