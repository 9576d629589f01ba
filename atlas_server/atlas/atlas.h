#pragma once

#include <deque>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "atlas/map_graph.h"
#include "base/result.h"
#include "map/protocol.h"

namespace portolan {

/// Which process owns which map in which epoch, where the trackers are, and how maps belong together: the decisions of
/// the atlas_server, as functions from what it hears to what it says. Without DDS, clock or threads; time is given in
/// seconds of any steady clock.
///
///   Atlas atlas(my_process, now_s);
///   atlas.Restore(store.ownerships(), graph);
///   atlas.OnRequest(request, now_s); atlas.OnStatus(status, now_s); atlas.OnTick(now_s);
///   for (const Atlas::Ownership& o : atlas.TakeGrants()) store.SaveOwnership(o);   // before anybody hears of it
///   publish(atlas.TakeCommands()); publish(atlas.TakeReplies());
///   for (const Atlas::Move& move : atlas.TakeMoves()) joiner.OnMove(move, now_s);
///
/// The rules:
/// - A robot has one mapper at a time: the first that registers. Another is refused as soon as that one shows that it
/// lives, unless it registers as "standby" (argument of the request); when the mapper dies, a standby or whoever
/// registers next has its place. A standby that follows an earlier atlas_server's word is known by its status. How one
/// leaves its place to a standby: Succession.
/// - A map that a tracker asks for is granted to its robot's mapper, once there is one. A tracker's wanted maps (the
/// one it asked for last, the one it is in) pass on to its robot's mapper when their owner is dead. Each grant is in
/// the next epoch; an epoch never falls.
/// - A map in which no tracker is and that none waits for is dormant: this process owns it, from the moment on that its
/// mapper has nothing left to do in it. A tracker that is silent for kGoneS is gone.
/// - Processes that were here before the atlas_server: it listens for kListenS before it decides anything, and takes up
/// what their statuses tell. The same after a time in which it did not run itself (hung, stopped, its machine asleep):
/// that it has heard nobody for so long says nothing of them.
/// - One that stands by behind another atlas_server hears everything and decides nothing, until it is promoted.
class Atlas {
 public:
  /// A map as far as it is owned.
  struct Ownership {
    MapId map;
    RobotId robot = 0;  ///< whose tracker asked for it
    Epoch epoch = 0;    ///< 0: nobody was granted it yet
    ProcessId owner;
  };

  /// What a tracker said of a map: that it is in it now, or why it did not go there.
  struct Move {
    ProcessId tracker;
    bool entered = false;
    MapId map, other;  ///< other: where it was (may be none)
    std::string reason;
  };

  Atlas(ProcessId self, double start_s) : self_(self), start_s_(start_s), last_time_s_(start_s) {}

  /// What an earlier atlas_server granted and knew.
  void Restore(const std::vector<Ownership>& ownerships, const MapGraph& graph = MapGraph());

  // Behind another atlas_server.
  void StandBy() { is_standby_ = true; }
  /// Has heard all that it needs to know.
  void Promote(double now_s);
  bool is_standby() const { return is_standby_; }
  /// What the other granted, and its map graph.
  void Follow(const std::vector<Ownership>& ownerships);
  void Follow(const MapGraph& graph) { graph_ = graph; }
  /// The other deleted a map.
  void FollowDeletion(MapId map);

  /// Answers, but for "activate", "fuse", "locate" and "swap": see TakeOrders().
  void OnRequest(const Request& request, double now_s);
  void OnStatus(const ProcessStatus& status, double now_s);
  void OnMapperState(const MapperState& state, double now_s);
  /// A map has so many keyframes.
  void OnSize(MapId map, size_t keyframes);
  /// Any other message of a process shows that it lives.
  void OnSignOfLife(ProcessId process, double now_s);
  /// A map was seen in this epoch (in a delta): later grants are above it.
  void OnEpoch(MapId map, Epoch epoch);
  /// A map that came from a file: it is dormant from now on, in an epoch above that.
  void Adopt(MapId map, Epoch epoch);
  /// A few times a second: what follows from silence.
  void OnTick(double now_s);

  /// What has been decided since the last call: in this order to be stored, and published.
  std::vector<Ownership> TakeGrants();
  std::vector<Command> TakeCommands();
  std::vector<Reply> TakeReplies();
  std::vector<Move> TakeMoves() { return std::exchange(moves_, {}); }
  /// Requests that someone else answers, with Answer(): each comes once, however often it is repeated.
  std::vector<Request> TakeOrders() { return std::exchange(orders_, {}); }
  void Answer(const Request& order, Reply reply);
  /// Refuses an order, unless what is heard within kHearS changes that: until then it comes again with each tick.
  void RefuseAtLast(const Request& order, const std::string& reason, double now_s);
  /// Maps that were deleted on request.
  std::vector<MapId> TakeDeleted() { return std::exchange(just_deleted_, {}); }

  // What the joiner decides.
  /// The tracker of a robot is to go on in `map`. @param other where it is; none: nowhere.
  void Activate(RobotId robot, MapId map, MapId other, const Sim3d& map_from_other);
  /// Stores and publishes where two maps lie to each other.
  void LinkMaps(const MapGraph::Link& link);
  /// Gives a map to a mapper, and leaves it there until released.
  void Hold(MapId map, ProcessId owner, double now_s);
  void Release(MapId map) { holds_.erase(map); }
  /// `other` went into `map`.
  void Fuse(MapId map, MapId other, const Sim3d& map_from_other);

  // What the succession decides (atlas_places.cc).
  /// To a process, about itself or about whoever it is to follow: kDrain, kAppoint....
  void Tell(CommandKind kind, RobotId robot, ProcessId process);
  /// While the mapper of a robot leaves its place nothing new is given to it.
  void SetLeaving(RobotId robot, bool is_leaving) { robots_[robot].is_leaving = is_leaving; }
  /// `to` is the robot's mapper from now on, and owns all that the one before did, each map in its next epoch.
  void ReplaceMapper(RobotId robot, ProcessId to);
  /// Of a robot; for atlas_servers of any. The one that has the place, and lives; none: there is none.
  ProcessId HolderOf(const std::string& role, RobotId robot, double now_s) const;
  /// Those that wait for it, and live; by id.
  std::vector<ProcessId> StandbysOf(const std::string& role, RobotId robot, double now_s) const;
  /// Robots with a living process of this role, by number.
  std::set<RobotId> RobotsWith(const std::string& role, double now_s) const;
  std::vector<Ownership> MapsOf(ProcessId owner) const;
  /// Whether the map is left where it is, until it was fused.
  bool IsHeld(MapId map) const { return holds_.count(map) == 1; }
  /// What a process told of itself last; null if it has not.
  const ProcessStatus* StatusOf(ProcessId process) const;
  /// When it was heard of first; infinity if it was not.
  double FirstSeen(ProcessId process) const;
  /// Its name, process number and host, for people.
  std::string Describe(ProcessId process) const;

  const std::map<MapId, Ownership>& maps() const { return maps_; }
  const MapGraph& graph() const { return graph_; }
  /// Where a map's keyframes are now, if it was fused.
  MapId Resolve(MapId map) const { return graph_.Resolve(map).first; }
  size_t SizeOf(MapId map) const;
  /// The last epoch granted of a map that was deleted; 0: it was not. One that comes back begins above it.
  Epoch DeletedEpoch(MapId map) const;
  /// Whether a tracker is in it.
  bool IsActive(MapId map, double now_s) const;
  /// In the map, and not gone; by id.
  std::vector<ProcessId> TrackersIn(MapId map, double now_s) const;
  /// Trackers of a robot that are not gone; by id.
  std::vector<ProcessId> TrackersOf(RobotId robot, double now_s) const;
  /// Where a tracker is, as far as it told; none if unknown.
  MapId MapOf(ProcessId tracker) const;
  /// The robot that a request is about: its argument, else the sender's if it has a tracker, else the only one that
  /// has.
  Result<RobotId> RobotOf(const Request& request, double now_s) const;
  /// Whether the tracker of a robot would do what it is told, as far as its last status says. @return why not.
  Status WouldObey(CommandKind kind, RobotId robot, double now_s) const;
  bool IsAlive(ProcessId process, double now_s) const;
  /// Requests that wait: for a map without a mapper, or to register while another may live.
  size_t num_pending() const;
  uint64_t num_takeovers() const { return takeovers_; }

  static constexpr const char* kMapperRole = "backend_mapper";
  static constexpr const char* kLoopRole = "loop_closer";
  static constexpr const char* kAtlasRole = "atlas_server";

  /// A process publishes its status each second, at a busy moment a little late.
  static constexpr double kAliveS = 1.5;
  /// The last status of each living process arrives when it is discovered, within half a second or so.
  static constexpr double kListenS = 1.0;
  /// A mapper repeats its registration each second until it is answered: one that keeps silent about it for so long has
  /// been registered before.
  static constexpr double kAdoptAfterS = 2.5;
  /// What an order depends on may be under way for so long: a process that was just started and is discovered here
  /// later than elsewhere, a status that tells what a process does now.
  static constexpr double kHearS = 4.0;
  /// A tracker that is silent for so long is gone: its maps are not held for it.
  static constexpr double kGoneS = 5.0;
  /// A map that nobody wants is left to its mapper for a moment, which may have keyframes of it in its queue, ...
  static constexpr double kDormantAfterS = 1.0;
  /// ... and for so long at most, if that does not come to rest.
  static constexpr double kDormantAtLastS = 10.0;

 private:
  struct Peer {
    ProcessStatus status;  ///< the last; empty before the first
    double first_seen_s = 0, last_seen_s = 0;
  };
  struct Robot {
    ProcessId mapper;
    /// The mapper was here before this atlas_server, and may own maps of which nobody has told yet.
    bool adopted = false;
    std::vector<ProcessId> standbys;  ///< in the order of their registration
    bool is_leaving = false;          ///< the mapper: gets nothing new
  };
  struct Tracker {
    MapId in;         ///< as its status tells, or its last enter_map
    MapId asked_for;  ///< a new map that it is not in yet
    double last_seen_s = 0;
  };

  /// A request whose answer depends on whether another mapper lives.
  struct Registration {
    Request request;
    double since_s = 0;
  };

  void Handle(const Request& request, double now_s);
  std::optional<Reply> TryAnswer(const Request& request, double now_s);
  Reply AnswerNewMap(const Request& request, double now_s);
  Reply AnswerEnterMap(const Request& request, double now_s);
  Reply AnswerRefuseMap(const Request& request);
  Reply AnswerLinkMaps(const Request& request);
  Reply AnswerDeleteMap(const Request& request, double now_s);
  /// Whether it is an order that a tracker or loop_closer is to carry out.
  static bool IsForwarded(const std::string& kind);
  void Forward(const Request& request, double now_s);
  Result<RobotId> AdjusterOf(MapId map, double now_s) const;
  std::optional<Reply> AnswerRegistration(const Registration& registration, double now_s);
  void DecideRegistrations(double now_s);
  void AddStandby(ProcessId mapper);
  bool HasMapper(RobotId robot, double now_s) const;
  void TakeUp(const ProcessStatus& status);
  void OnTracker(const ProcessStatus& status, double now_s);
  void AdoptMappers(double now_s);
  void PromoteStandby(Robot* robot, double now_s);
  void Serve(RobotId robot, MapId map, double now_s);
  void PutToRest(double now_s);
  bool IsWanted(MapId map, double now_s) const;
  bool IsHere(const Tracker& tracker, double now_s) const { return now_s - tracker.last_seen_s <= kGoneS; }
  void Decide(double now_s);
  Command MakeCommand(CommandKind kind, MapId map);
  void Grant(Ownership* map, ProcessId owner);
  void Send(const Request& request, Reply reply);
  bool Listening(double now_s) const { return is_standby_ || now_s - start_s_ < kListenS; }
  void NoteTime(double now_s);

  ProcessId self_;
  double start_s_;      // of listening
  double last_time_s_;  // that was told
  bool is_standby_ = false;
  std::map<MapId, Ownership> maps_;
  std::set<MapId> granted_here_;  // not by an earlier atlas_server
  std::map<ProcessId, Peer> peers_;
  std::map<RobotId, Robot> robots_;
  std::map<ProcessId, Tracker> trackers_;
  std::map<ProcessId, bool> idle_;  // mappers
  MapGraph graph_;
  std::map<MapId, size_t> sizes_;  // keyframes
  std::map<MapId, ProcessId> holds_;
  std::map<MapId, double> unwanted_since_s_;
  std::map<MapId, Epoch> deleted_;  // what still comes of them is late; with the last epoch granted
  std::set<MapId> told_fusions_;    // maps whose fusion was published by this session
  std::set<ProcessId> registered_;  // processes whose registration was answered, either way
  std::vector<Request> early_;      // came while listening
  std::vector<Registration> registrations_;
  std::map<RequestId, Reply> answers_;  // to requests that are repeated
  std::deque<RequestId> answer_order_;
  uint64_t commands_made_ = 0, takeovers_ = 0;
  std::vector<Ownership> grants_;
  std::vector<Command> commands_;
  std::vector<Reply> replies_;
  std::vector<Move> moves_;
  std::vector<Request> orders_;
  std::set<RequestId> open_orders_;
  std::vector<Request> refused_orders_;          // that come again with the next tick
  std::map<RequestId, double> refused_since_s_;  // of those
  std::vector<MapId> just_deleted_;
};

}  // namespace portolan
