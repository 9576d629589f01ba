#pragma once

#include <gtest/gtest.h>

#include <map>
#include <string>
#include <vector>

#include "atlas/map_joiner.h"

// What tests of the atlas's decisions share: a clock, processes that tell that they live whenever it goes on, and what
// was said.

namespace portolan {

inline const ProcessId kServer(0, 1, 1);
inline const ProcessId kTracker(3, 10, 1), kMapper(3, 20, 1);            // of robot 3
inline const ProcessId kOtherTracker(4, 11, 1), kOtherMapper(4, 21, 1);  // of robot 4
inline const MapId kOld(3, 10, 1), kNew(3, 10, 2), kOthers(4, 11, 1);

class AtlasWorld : public ::testing::Test {
 protected:
  /// All tell their statuses four times a second.
  void Go(double seconds) {
    for (const double end = now_ + seconds; now_ + 1e-9 < end;) {
      now_ += 0.25;
      for (const auto& [process, status] : living_) atlas_.OnStatus(status, now_);
      atlas_.OnTick(now_);
      joiner_.OnTick(now_);
      Collect();
    }
  }

  void Live(ProcessId process, const std::string& role, MapId map = MapId(), Epoch epoch = 0) {
    ProcessStatus& status = living_[process];
    status.process = process;
    status.role = role;
    status.map = map;
    status.epoch = epoch;
  }
  void Track(ProcessId tracker, MapId map) {
    Live(tracker, "frontend_tracker", map, 1);
    atlas_.OnStatus(living_[tracker], now_);
    Collect();
  }
  void Die(ProcessId process) { living_.erase(process); }

  RequestId Ask(Request request) {
    request.id = ids_.Next();
    atlas_.OnRequest(request, now_);
    Collect();
    return request.id;
  }
  RequestId Ask(ProcessId sender, const std::string& kind, MapId map = MapId(), MapId other = MapId(),
                const std::string& argument = "", const Sim3d& map_from_other = Sim3d()) {
    Request request;
    request.sender = sender;
    request.kind = kind;
    request.map = map;
    request.other = other;
    request.argument = argument;
    request.map_from_other = map_from_other;
    return Ask(request);
  }

  void Collect() {
    for (const Atlas::Move& move : atlas_.TakeMoves()) joiner_.OnMove(move, now_);
    for (const Atlas::Ownership& grant : atlas_.TakeGrants()) owners_[grant.map] = grant.owner;
    for (const Command& command : atlas_.TakeCommands()) {
      EXPECT_EQ(command.sender, kServer);
      commands_.push_back(command);
    }
    for (const Reply& reply : atlas_.TakeReplies()) replies_[reply.id].push_back(reply);
  }

  Reply ReplyTo(RequestId id) {
    EXPECT_EQ(replies_[id].size(), 1u);
    return replies_[id].empty() ? Reply() : replies_[id].back();
  }
  /// Why an order is refused: not at once, since what changes that may be under way.
  std::string ReasonAgainst(RequestId id) {
    EXPECT_TRUE(replies_[id].empty());
    Go(Atlas::kHearS + 0.5);
    EXPECT_FALSE(ReplyTo(id).ok);
    return ReplyTo(id).reason;
  }
  std::vector<Command> Commands(CommandKind kind) const {
    std::vector<Command> of_kind;
    for (const Command& command : commands_) {
      if (command.kind == kind) of_kind.push_back(command);
    }
    return of_kind;
  }
  ProcessId Owner(MapId map) const { return atlas_.maps().at(map).owner; }
  Epoch EpochOf(MapId map) const { return atlas_.maps().at(map).epoch; }

  /// Robot 3 is in a map with so many keyframes, and has another map that it left.
  void StartInNewMap(size_t old_size, size_t new_size) {
    Go(2);
    Live(kMapper, "backend_mapper");
    Live(kTracker, "frontend_tracker");
    Ask(kMapper, "register_mapper");
    Ask(kTracker, "new_map", kOld);
    Track(kTracker, kOld);
    Ask(kTracker, "new_map", kNew, kOld);
    Track(kTracker, kNew);
    atlas_.OnSize(kOld, old_size);
    atlas_.OnSize(kNew, new_size);
    Go(2);
    ASSERT_EQ(Owner(kOld), kServer);
    ASSERT_EQ(Owner(kNew), kMapper);
    commands_.clear();
  }
  /// Robot 4 is in a map of its own.
  void StartOtherRobot(size_t size) {
    Live(kOtherMapper, "backend_mapper");
    Live(kOtherTracker, "frontend_tracker");
    Ask(kOtherMapper, "register_mapper");
    Ask(kOtherTracker, "new_map", kOthers);
    Track(kOtherTracker, kOthers);
    atlas_.OnSize(kOthers, size);
    ASSERT_EQ(Owner(kOthers), kOtherMapper);
    commands_.clear();
  }

  static Sim3d OldFromNew() { return Sim3d(1.5, Eigen::Quaterniond::Identity(), {1, 2, 3}); }
  static DetectedOverlap Overlap(MapId map, MapId other) {
    DetectedOverlap overlap;
    overlap.map = map;
    overlap.other = other;
    overlap.current = KeyFrameId(map.robot(), 10, 200);
    overlap.matched = KeyFrameId(other.robot(), 10, 100);
    overlap.other_from_map = OldFromNew();
    return overlap;
  }

  double now_ = 100;
  Atlas atlas_{kServer, 100};
  MapJoiner joiner_{kServer, JoinOptions(), &atlas_};
  std::map<ProcessId, ProcessStatus> living_;
  IdMinter<RequestId> ids_{3, 7};
  std::map<MapId, ProcessId> owners_;
  std::vector<Command> commands_;
  std::map<RequestId, std::vector<Reply>> replies_;
};

}  // namespace portolan
