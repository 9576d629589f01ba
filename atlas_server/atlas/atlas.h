#pragma once

#include <deque>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "map/protocol.h"

namespace portolan {

/// Which process owns which map in which epoch: the decisions of the atlas_server, as functions from what it hears to
/// what it says. Without DDS, clock or threads; time is given in seconds of any steady clock.
///
///   Atlas atlas(my_process, now_s);
///   atlas.Restore(store.ownerships());
///   atlas.OnRequest(request, now_s); atlas.OnStatus(status, now_s); atlas.OnTick(now_s);
///   for (const Atlas::Ownership& o : atlas.TakeGrants()) store.SaveOwnership(o);   // before anybody hears of it
///   publish(atlas.TakeCommands()); publish(atlas.TakeReplies());
///
/// The rules:
/// - A robot has one mapper at a time: the first that registers. Another is refused as soon as that one shows that it
/// lives, unless it registers as
///   "standby" (argument of the request); when the mapper dies, a standby or whoever registers next has its place.
/// - A map that a tracker asks for is granted to its robot's mapper, once there is one. A robot's wanted maps (the one
/// asked for last, the one its
///   tracker is in) pass on to the robot's mapper when their owner is dead. Each grant is in the next epoch; an epoch
///   never falls.
/// - Processes that were here before the atlas_server: it listens for kListenS before it decides anything, and takes up
/// what their statuses tell.
class Atlas {
 public:
  /// A map as far as it is owned.
  struct Ownership {
    MapId map;
    RobotId robot = 0;  ///< whose tracker asked for it
    Epoch epoch = 0;    ///< 0: nobody was granted it yet
    ProcessId owner;
  };

  Atlas(ProcessId self, double start_s) : self_(self), start_s_(start_s) {}

  /// What an earlier atlas_server granted.
  void Restore(const std::vector<Ownership>& ownerships);

  void OnRequest(const Request& request, double now_s);
  void OnStatus(const ProcessStatus& status, double now_s);
  /// Any other message of a process shows that it lives.
  void OnSignOfLife(ProcessId process, double now_s);
  /// A map was seen in this epoch (in a delta): later grants are above it.
  void OnEpoch(MapId map, Epoch epoch);
  /// A few times a second: what follows from silence.
  void OnTick(double now_s);

  /// What has been decided since the last call: in this order to be stored, and published.
  std::vector<Ownership> TakeGrants();
  std::vector<Command> TakeCommands();
  std::vector<Reply> TakeReplies();

  const std::map<MapId, Ownership>& maps() const { return maps_; }
  bool IsAlive(ProcessId process, double now_s) const;
  /// Requests that wait: for a map without a mapper, or to register while another may live.
  size_t num_pending() const;
  uint64_t num_takeovers() const { return takeovers_; }

  /// A process publishes its status each second, at a busy moment a little late.
  static constexpr double kAliveS = 1.5;
  /// The last status of each living process arrives when it is discovered, within half a second or so.
  static constexpr double kListenS = 1.0;
  /// A mapper repeats its registration each second until it is answered: one that keeps silent about it for so long has
  /// been registered before.
  static constexpr double kAdoptAfterS = 2.5;

 private:
  struct Peer {
    ProcessStatus status;  ///< the last; empty before the first
    double first_seen_s = 0, last_seen_s = 0;
  };
  struct Robot {
    ProcessId mapper;
    bool adopted =
        false;  ///< the mapper was here before this atlas_server, and may own maps of which nobody has told yet
    std::vector<ProcessId> standbys;  ///< in the order of their registration
    MapId asked_for;                  ///< last
    MapId tracked;
  };

  /// A request whose answer depends on whether another mapper lives.
  struct Registration {
    Request request;
    double since_s = 0;
  };

  void Answer(const Request& request, double now_s);
  Reply AnswerNewMap(const Request& request);
  std::optional<Reply> AnswerRegistration(const Registration& registration, double now_s);
  void DecideRegistrations(double now_s);
  std::string Describe(ProcessId process) const;
  void TakeUp(const ProcessStatus& status);
  void AdoptMappers(double now_s);
  void PromoteStandby(Robot* robot, double now_s);
  void Serve(const Robot& robot, MapId map, double now_s);
  void Decide(double now_s);
  void Grant(Ownership* map, ProcessId owner);
  void Send(const Request& request, Reply reply);
  bool Listening(double now_s) const { return now_s - start_s_ < kListenS; }

  ProcessId self_;
  double start_s_;
  std::map<MapId, Ownership> maps_;
  std::map<ProcessId, Peer> peers_;
  std::map<RobotId, Robot> robots_;
  std::set<ProcessId> registered_;  // processes whose registration was answered, either way
  std::vector<Request> early_;      // came while listening
  std::vector<Registration> registrations_;
  std::map<RequestId, Reply> answers_;  // to requests that are repeated
  std::deque<RequestId> answer_order_;
  uint64_t commands_made_ = 0, takeovers_ = 0;
  std::vector<Ownership> grants_;
  std::vector<Command> commands_;
  std::vector<Reply> replies_;
};

}  // namespace portolan
