#include "atlas/atlas.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "base/random.h"

namespace portolan {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;

const ProcessId kServer(0, 1, 1), kTracker(3, 10, 1), kMapperA(3, 20, 1), kMapperB(3, 30, 1);
const MapId kMap(3, 10, 1), kNextMap(3, 10, 2);

/// An atlas, a clock, and processes that tell that they live whenever the time goes on.
class AtlasTest : public ::testing::Test {
 protected:
  void Go(double seconds) {
    for (const double end = now_ + seconds; now_ + 1e-9 < end;) {
      now_ += 0.25;
      for (const auto& [process, status] : living_) atlas_.OnStatus(status, now_);
      atlas_.OnTick(now_);
    }
    Collect();
  }

  void Live(ProcessId process, const std::string& role, MapId map = MapId(), Epoch epoch = 0) {
    ProcessStatus& status = living_[process];
    status.process = process;
    status.role = role;
    status.host = "rack-2";
    status.pid = process.session();
    status.map = map;
    status.epoch = epoch;
  }
  void Mapper(ProcessId process, MapId map = MapId(), Epoch epoch = 0) { Live(process, "backend_mapper", map, epoch); }
  void Die(ProcessId process) { living_.erase(process); }

  RequestId Ask(ProcessId sender, const std::string& kind, MapId map = MapId(), const std::string& argument = "") {
    const RequestId id = ids_.Next();
    AskAgain(id, sender, kind, map, argument);
    return id;
  }
  void AskAgain(RequestId id, ProcessId sender, const std::string& kind, MapId map = MapId(),
                const std::string& argument = "") {
    Request request;
    request.id = id;
    request.sender = sender;
    request.kind = kind;
    request.map = map;
    request.argument = argument;
    atlas_.OnRequest(request, now_);
    Collect();
  }

  void Collect() {
    for (const Atlas::Ownership& grant : atlas_.TakeGrants()) grants_.push_back(grant);
    for (const Command& command : atlas_.TakeCommands()) commands_.push_back(command);
    for (const Reply& reply : atlas_.TakeReplies()) replies_[reply.id].push_back(reply);
  }

  /// The one and only reply to a request.
  Reply ReplyTo(RequestId id) {
    EXPECT_EQ(replies_[id].size(), 1u);
    return replies_[id].empty() ? Reply() : replies_[id].back();
  }

  void ExpectGrant(size_t index, MapId map, Epoch epoch, ProcessId owner) {
    ASSERT_GT(commands_.size(), index);
    EXPECT_EQ(commands_[index].kind, CommandKind::kGrantOwnership);
    EXPECT_EQ(commands_[index].map, map);
    EXPECT_EQ(commands_[index].epoch, epoch);
    EXPECT_EQ(commands_[index].owner, owner);
    EXPECT_EQ(commands_[index].sender, kServer);
    EXPECT_EQ(commands_[index].number, index + 1);
  }

  void ExpectAppointment(size_t index, ProcessId mapper) {
    ASSERT_GT(commands_.size(), index);
    EXPECT_EQ(commands_[index].kind, CommandKind::kAppointMapper);
    EXPECT_EQ(commands_[index].robot, mapper.robot());
    EXPECT_EQ(commands_[index].owner, mapper);
  }

  double now_ = 100;
  Atlas atlas_{kServer, 100};
  std::map<ProcessId, ProcessStatus> living_;
  IdMinter<RequestId> ids_{3, 7};
  std::vector<Atlas::Ownership> grants_;
  std::vector<Command> commands_;
  std::map<RequestId, std::vector<Reply>> replies_;
};

TEST_F(AtlasTest, GrantsANewMapToTheRobotsMapper) {
  Go(2);
  Mapper(kMapperA);
  Live(kTracker, "frontend_tracker");
  EXPECT_TRUE(ReplyTo(Ask(kMapperA, "register_mapper")).ok);
  EXPECT_TRUE(ReplyTo(Ask(kTracker, "new_map", kMap)).ok);
  ExpectGrant(0, kMap, 1, kMapperA);
  EXPECT_EQ(grants_.size(), 1u);
  Live(kTracker, "frontend_tracker", kMap, 1);
  Go(10);
  EXPECT_TRUE(ReplyTo(Ask(kTracker, "new_map", kNextMap)).ok);
  ExpectGrant(1, kNextMap, 1, kMapperA);
  Go(10);
  EXPECT_EQ(commands_.size(), 2u) << "it waits for the new map in the old one";
}

TEST_F(AtlasTest, KeepsARequestUntilAMapperComes) {
  Go(2);
  Live(kTracker, "frontend_tracker");
  EXPECT_TRUE(ReplyTo(Ask(kTracker, "new_map", kMap)).ok);
  EXPECT_EQ(atlas_.num_pending(), 1u);
  Go(5);
  EXPECT_THAT(commands_, IsEmpty());
  Mapper(kMapperA);
  Ask(kMapperA, "register_mapper");
  ExpectGrant(0, kMap, 1, kMapperA);
  EXPECT_EQ(atlas_.num_pending(), 0u);
}

TEST_F(AtlasTest, AMapperOfAnotherRobotGetsNothing) {
  Go(2);
  Ask(ProcessId(4, 1, 1), "register_mapper");
  Ask(kTracker, "new_map", kMap);
  EXPECT_THAT(commands_, IsEmpty());
}

TEST_F(AtlasTest, RepeatedRequestsAreAnsweredAgainAndDoNothing) {
  Go(2);
  Mapper(kMapperA);
  const RequestId registration = Ask(kMapperA, "register_mapper"), new_map = Ask(kTracker, "new_map", kMap);
  AskAgain(registration, kMapperA, "register_mapper");
  AskAgain(new_map, kTracker, "new_map", kMap);
  EXPECT_EQ(replies_[registration].size(), 2u);
  EXPECT_EQ(replies_[new_map].size(), 2u);
  EXPECT_TRUE(replies_[new_map][1].ok);
  EXPECT_EQ(commands_.size(), 1u);
  EXPECT_TRUE(ReplyTo(Ask(kTracker, "new_map", kMap)).ok) << "also under another id";
  EXPECT_EQ(commands_.size(), 1u);
}

TEST_F(AtlasTest, RefusesASecondMapperAndNamesTheFirst) {
  Go(2);
  Mapper(kMapperA);
  Ask(kMapperA, "register_mapper");
  Go(1);
  Mapper(kMapperB);
  const RequestId second = Ask(kMapperB, "register_mapper");
  Go(1);
  const Reply reply = ReplyTo(second);
  EXPECT_FALSE(reply.ok);
  EXPECT_THAT(reply.reason, HasSubstr("rack-2"));
  EXPECT_THAT(reply.reason, HasSubstr("pid " + std::to_string(kMapperA.session())));
  EXPECT_THAT(reply.reason, HasSubstr(ToString(kMapperA)));
  Ask(kTracker, "new_map", kMap);
  ExpectGrant(0, kMap, 1, kMapperA);
}

TEST_F(AtlasTest, AMapperThatComesBackGoesOnInTheNextEpoch) {
  Go(2);
  Mapper(kMapperA);
  Ask(kMapperA, "register_mapper");
  Ask(kTracker, "new_map", kMap);
  Die(kMapperA);
  Go(3);
  EXPECT_EQ(commands_.size(), 1u);
  Mapper(kMapperB);
  EXPECT_TRUE(ReplyTo(Ask(kMapperB, "register_mapper")).ok);
  ExpectGrant(1, kMap, 2, kMapperB);
  EXPECT_EQ(atlas_.num_takeovers(), 1u);
}

/// A script starts a mapper anew as soon as it has died: it must wait for the answer, not be refused.
TEST_F(AtlasTest, ASuccessorStartedAtOnceIsNotRefused) {
  Go(2);
  Mapper(kMapperA);
  Ask(kMapperA, "register_mapper");
  Ask(kTracker, "new_map", kMap);
  Die(kMapperA);
  Mapper(kMapperB);
  const RequestId second = Ask(kMapperB, "register_mapper");
  EXPECT_THAT(replies_[second], IsEmpty());
  EXPECT_EQ(atlas_.num_pending(), 1u);
  Go(Atlas::kAliveS + 0.5);
  EXPECT_TRUE(ReplyTo(second).ok);
  ExpectGrant(1, kMap, 2, kMapperB);
}

TEST_F(AtlasTest, OnlyWantedMapsPassOn) {
  Go(2);
  Mapper(kMapperA);
  Ask(kMapperA, "register_mapper");
  Ask(kTracker, "new_map", kMap);
  Ask(kTracker, "new_map", kNextMap);
  Live(kTracker, "frontend_tracker", kNextMap, 1);
  Die(kMapperA);
  Go(3);
  Mapper(kMapperB);
  Ask(kMapperB, "register_mapper");
  Go(2);
  EXPECT_EQ(commands_.size(), 4u);
  ExpectGrant(2, kMap, 2, kServer);  // nobody is in it
  ExpectGrant(3, kNextMap, 2, kMapperB);
  Live(kTracker, "frontend_tracker", kMap, 1);  // found its way back into the old map
  Go(0.5);
  ExpectGrant(4, kMap, 3, kMapperB);
}

TEST_F(AtlasTest, AStandbyTakesOverAndTheSleeperBecomesStandby) {
  Go(2);
  Mapper(kMapperA);
  Ask(kMapperA, "register_mapper");
  Ask(kTracker, "new_map", kMap);
  Live(kTracker, "frontend_tracker", kMap, 1);
  Mapper(kMapperB);
  EXPECT_TRUE(ReplyTo(Ask(kMapperB, "register_mapper", MapId(), "standby")).ok);
  Go(5);
  EXPECT_EQ(commands_.size(), 1u);
  Die(kMapperA);
  Go(2);
  ExpectAppointment(1, kMapperB);
  ExpectGrant(2, kMap, 2, kMapperB);
  Mapper(kMapperA, kMap, 1);  // it only slept, and believes that it owns the map
  Go(5);
  EXPECT_EQ(commands_.size(), 3u);
  EXPECT_EQ(atlas_.maps().at(kMap).owner, kMapperB);
  Die(kMapperB);
  Go(2);
  ExpectAppointment(3, kMapperA);
  ExpectGrant(4, kMap, 3, kMapperA);
}

TEST_F(AtlasTest, ListensBeforeItDecides) {
  Mapper(kMapperA);
  const RequestId registration = Ask(kMapperA, "register_mapper"), new_map = Ask(kTracker, "new_map", kMap);
  AskAgain(new_map, kTracker, "new_map", kMap);
  EXPECT_THAT(replies_[registration], IsEmpty());
  EXPECT_EQ(atlas_.num_pending(), 2u);
  Go(Atlas::kListenS + 0.25);
  EXPECT_TRUE(ReplyTo(registration).ok);
  EXPECT_TRUE(ReplyTo(new_map).ok);
  ExpectGrant(0, kMap, 1, kMapperA);
}

/// A restarted atlas_server, with and without its store, leaves a living mapper alone.
TEST_F(AtlasTest, TakesUpALivingMapper) {
  for (const bool with_store : {true, false}) {
    atlas_ = Atlas(kServer, now_);
    commands_.clear();
    if (with_store) atlas_.Restore({{kMap, 3, 4, kMapperA}});
    Mapper(kMapperA, kMap, 4);
    Live(kTracker, "frontend_tracker", kMap, 4);
    Mapper(kMapperB);
    const RequestId second = Ask(kMapperB, "register_mapper");
    Go(3);
    EXPECT_FALSE(ReplyTo(second).ok);
    EXPECT_THAT(commands_, IsEmpty());
    EXPECT_EQ(atlas_.maps().at(kMap).owner, kMapperA);
    EXPECT_EQ(atlas_.maps().at(kMap).epoch, 4u);
    Die(kMapperB);
    Ask(kTracker, "new_map", kNextMap);
    ExpectGrant(0, kNextMap, 1, kMapperA);
  }
}

/// It was registered by the atlas_server before, owns nothing yet, and will not register again.
TEST_F(AtlasTest, TakesUpALivingMapperWithoutAMap) {
  Mapper(kMapperA);
  Go(2);
  Ask(kTracker, "new_map", kMap);
  EXPECT_THAT(commands_, IsEmpty()) << "it may be about to register";
  Go(Atlas::kAdoptAfterS);
  ExpectGrant(0, kMap, 1, kMapperA);
}

TEST_F(AtlasTest, AMapOfAMapperThatWasHereBeforeIsNotTakenFromIt) {
  Mapper(kMapperA, kMap, 2);
  Live(kTracker, "frontend_tracker", kNextMap, 1);
  Live(ProcessId(3, 11, 1), "frontend_tracker", kMap, 2);
  Go(3);
  atlas_.OnEpoch(kNextMap, 1);  // seen in a delta; the mapper's status tells of its other map
  Go(3);
  EXPECT_THAT(commands_, IsEmpty());
  EXPECT_EQ(atlas_.maps().at(kNextMap).owner, kMapperA);
}

TEST_F(AtlasTest, EpochsGoOnAboveTheStoredAndTheSeen) {
  atlas_.Restore({{kMap, 3, 6, kMapperA}});
  Live(kTracker, "frontend_tracker", kMap, 6);
  Mapper(kMapperB);
  Ask(kMapperB, "register_mapper");
  Go(2);
  ExpectGrant(0, kMap, 7, kMapperB);
  atlas_.OnEpoch(kMap, 5);
  EXPECT_EQ(atlas_.maps().at(kMap).epoch, 7u);
  EXPECT_EQ(atlas_.maps().at(kMap).owner, kMapperB);
  atlas_.OnEpoch(kMap, 9);
  Go(1);
  EXPECT_GE(commands_.back().epoch, 10u);
}

TEST_F(AtlasTest, RefusesWhatItDoesNotKnow) {
  Go(2);
  const Reply reply = ReplyTo(Ask(kTracker, "make_coffee"));
  EXPECT_FALSE(reply.ok);
  EXPECT_THAT(reply.reason, HasSubstr("make_coffee"));
  const Reply without_map = ReplyTo(Ask(kTracker, "new_map"));
  EXPECT_FALSE(without_map.ok);
  EXPECT_THAT(without_map.reason, HasSubstr("map's id"));
}

/// Whatever happens in whatever order: epochs of a map rise by every grant, and no living owner loses a map that is in
/// use.
TEST_F(AtlasTest, EpochsNeverFallAndLivingOwnersStay) {
  Random random(11);
  const std::vector<ProcessId> mappers = {kMapperA, kMapperB, ProcessId(3, 40, 1), ProcessId(3, 50, 1)};
  const std::vector<MapId> maps = {kMap, kNextMap, MapId(3, 10, 3)};
  std::map<MapId, Epoch> last;
  for (int step = 0; step < 3000; ++step) {
    const ProcessId mapper = mappers[random.Below(mappers.size())];
    const MapId map = maps[random.Below(maps.size())];
    std::map<MapId, ProcessId> living_owners;
    for (const auto& [id, ownership] : atlas_.maps()) {
      if (id == atlas_.MapOf(kTracker) && living_.count(ownership.owner) == 1 && atlas_.IsAlive(ownership.owner, now_))
        living_owners[id] = ownership.owner;
    }
    switch (random.Below(7)) {
      case 0:
        Mapper(mapper);
        break;
      case 1:
        Die(mapper);
        break;
      case 2:
        Ask(mapper, "register_mapper", MapId(), random.Below(2) == 0 ? "standby" : "");
        break;
      case 3:
        Ask(kTracker, "new_map", map);
        break;
      case 4:
        Live(kTracker, "frontend_tracker", map, 1);
        break;
      case 5:
        Go(0.25);
        break;
      case 6:
        Go(2);
        break;
    }
    for (const Command& command : commands_) {
      if (command.kind != CommandKind::kGrantOwnership) continue;
      EXPECT_GT(command.epoch, last[command.map]);
      last[command.map] = command.epoch;
    }
    for (const auto& [id, owner] : living_owners) {
      if (living_.count(owner) == 0 || id != atlas_.MapOf(kTracker)) continue;
      EXPECT_EQ(atlas_.maps().at(id).owner, owner) << "step " << step;
    }
    commands_.clear();
  }
  EXPECT_GT(atlas_.num_takeovers(), 20u);
}

TEST_F(AtlasTest, OneThatHungItselfListensBeforeItDecides) {
  Go(2);
  Mapper(kMapperA);
  Mapper(kMapperB);
  Live(kTracker, "frontend_tracker", kMap, 1);
  Ask(kMapperA, "register_mapper");
  Ask(kMapperB, "register_mapper", MapId(), "standby");
  Ask(kTracker, "new_map", kMap);
  Go(1);
  ExpectGrant(0, kMap, 1, kMapperA);
  now_ += 10;  // the others lived on; the standby is heard of first
  atlas_.OnStatus(living_[kMapperB], now_);
  atlas_.OnStatus(living_[kTracker], now_);
  Go(3);
  EXPECT_EQ(commands_.size(), 1u) << "nobody died";
  Die(kMapperA);
  Go(3);
  ExpectAppointment(1, kMapperB);
  ExpectGrant(2, kMap, 2, kMapperB);
}

}  // namespace
}  // namespace portolan
