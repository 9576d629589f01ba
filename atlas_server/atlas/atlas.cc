#include "atlas/atlas.h"

#include <algorithm>
#include <utility>

namespace portolan {
namespace {

constexpr size_t kMaxAnswers = 1024;  // remembered: a request is repeated for seconds, not for hours
constexpr size_t kMaxEarly = 256;     // requests while listening; whoever is not answered asks again
constexpr const char* kTrackerRole = "frontend_tracker";

}  // namespace

void Atlas::Restore(const std::vector<Ownership>& ownerships, const MapGraph& graph) {
  graph_ = graph;
  for (const Ownership& ownership : ownerships) maps_[ownership.map] = ownership;
}

/// A few times a second there is a tick: where none was for long, this process did not run.
void Atlas::NoteTime(double now_s) {
  if (now_s - last_time_s_ > kListenS) start_s_ = now_s;
  last_time_s_ = now_s;
}

void Atlas::OnRequest(const Request& request, double now_s) {
  NoteTime(now_s);
  OnSignOfLife(request.sender, now_s);
  if (is_standby_) return;
  if (Listening(now_s)) {
    const bool repeated =
        std::any_of(early_.begin(), early_.end(), [&](const Request& early) { return early.id == request.id; });
    if (!repeated && early_.size() < kMaxEarly) early_.push_back(request);
    return;
  }
  Handle(request, now_s);
  Decide(now_s);
}

void Atlas::Handle(const Request& request, double now_s) {
  const auto before = answers_.find(request.id);
  if (before != answers_.end()) {
    replies_.push_back(before->second);
    return;
  }
  if (request.kind == "register_mapper") {
    const bool waits = std::any_of(registrations_.begin(), registrations_.end(),
                                   [&](const auto& r) { return r.request.id == request.id; });
    if (!waits) registrations_.push_back({request, now_s});
    return;
  }
  if (request.kind == "activate" || request.kind == "fuse" || request.kind == "locate" || request.kind == "swap") {
    if (open_orders_.insert(request.id).second) orders_.push_back(request);
    return;
  }
  if (IsForwarded(request.kind)) {
    if (open_orders_.insert(request.id).second) Forward(request, now_s);
    return;
  }
  if (std::optional<Reply> reply = TryAnswer(request, now_s)) return Send(request, std::move(*reply));
  Reply refusal;
  refusal.reason =
      "unknown request '" + request.kind +
      "': expected new_map, enter_map, refuse_map, link_maps, locate, register_mapper, list_maps, map_graph, save, "
      "activate, "
      "fuse, delete_map, import_map, start_map, global_ba, pause, resume, localize_only, map_again or swap";
  Send(request, std::move(refusal));
}

std::optional<Reply> Atlas::TryAnswer(const Request& request, double now_s) {
  const std::string& kind = request.kind;
  if (kind == "new_map") return AnswerNewMap(request, now_s);
  if (kind == "enter_map") return AnswerEnterMap(request, now_s);
  if (kind == "refuse_map") return AnswerRefuseMap(request);
  if (kind == "link_maps") return AnswerLinkMaps(request);
  if (kind == "delete_map") return AnswerDeleteMap(request, now_s);
  return std::nullopt;
}

void Atlas::Answer(const Request& order, Reply reply) {
  open_orders_.erase(order.id);
  Send(order, std::move(reply));
}

void Atlas::RefuseAtLast(const Request& order, const std::string& reason, double now_s) {
  const double since_s = refused_since_s_.try_emplace(order.id, now_s).first->second;
  if (now_s - since_s < kHearS) {
    refused_orders_.push_back(order);
    return;
  }
  Reply reply;
  reply.reason = reason;
  Answer(order, std::move(reply));
}

void Atlas::Send(const Request& request, Reply reply) {
  refused_since_s_.erase(request.id);
  reply.id = request.id;
  reply.sender = self_;
  answers_[reply.id] = reply;
  answer_order_.push_back(reply.id);
  replies_.push_back(std::move(reply));
  if (answer_order_.size() <= kMaxAnswers) return;
  answers_.erase(answer_order_.front());
  answer_order_.pop_front();
}

/// Text: the number of maps with keyframes, for a tracker that may find itself in one of them.
Reply Atlas::AnswerNewMap(const Request& request, double now_s) {
  Reply reply;
  if (!request.map.IsValid()) {
    reply.reason = "new_map without the map's id";
    return reply;
  }
  Ownership& map = maps_[request.map];
  if (!map.map.IsValid()) map = Ownership{request.map, request.sender.robot(), 0, ProcessId()};
  Tracker& tracker = trackers_[request.sender];
  tracker.asked_for = request.map;
  tracker.last_seen_s = now_s;
  graph_.AddNewMap(request.map, Resolve(request.other));
  reply.ok = true;
  reply.text =
      std::to_string(std::count_if(sizes_.begin(), sizes_.end(), [](const auto& size) { return size.second > 0; }));
  return reply;
}

/// The tracker is in another map: by command, or by itself. An identity is no knowledge of where the two lie.
Reply Atlas::AnswerEnterMap(const Request& request, double now_s) {
  Reply reply;
  const auto [map, map_from_asked] = graph_.Resolve(request.map);
  if (maps_.count(map) == 0) {
    reply.reason = "map " + ToString(request.map) + " is not known here";
    return reply;
  }
  const auto [other, other_from_asked] = graph_.Resolve(request.other);
  Tracker& tracker = trackers_[request.sender];
  tracker = {map, MapId(), now_s};
  moves_.push_back({request.sender, true, map, other, ""});
  reply.ok = true;
  if (!other.IsValid() || map == other) return reply;
  graph_.CountSwitch(map, other);
  const Sim3d& found = request.map_from_other;
  const bool is_identity = found.scale == 1 && found.translation.isZero(0) && found.rotation.vec().isZero(0);
  const auto known = graph_.FindLink(map, other);
  // A frame that is localised in both maps tells more of them than two keyframes do, but not than the frames a map
  // began with.
  if (!is_identity && (!known || known->origin != MapGraph::Origin::kNewMap)) {
    LinkMaps({map, other, map_from_asked * found * other_from_asked.Inverse(),
              known ? known->origin : MapGraph::Origin::kEntered});
  }
  return reply;
}

Reply Atlas::AnswerRefuseMap(const Request& request) {
  moves_.push_back({request.sender, false, Resolve(request.map), Resolve(request.other), request.argument});
  Reply reply;
  reply.ok = true;
  return reply;
}

Reply Atlas::AnswerLinkMaps(const Request& request) {
  Reply reply;
  const auto [map, map_from_asked] = graph_.Resolve(request.map);
  const auto [other, other_from_asked] = graph_.Resolve(request.other);
  if (!map.IsValid() || !other.IsValid() || map == other) {
    reply.reason = "link_maps needs two maps, got " + ToString(request.map) + " and " + ToString(request.other);
  } else if (!IsValidSimilarity(request.map_from_other)) {
    reply.reason = "link_maps with a similarity that is none";
  } else {
    LinkMaps(
        {map, other, map_from_asked * request.map_from_other * other_from_asked.Inverse(), MapGraph::Origin::kNewMap});
    reply.ok = true;
  }
  return reply;
}

Reply Atlas::AnswerDeleteMap(const Request& request, double now_s) {
  Reply reply;
  const std::string name = "map " + ToString(request.map);
  if (maps_.count(request.map) == 0) {
    reply.reason = name + " is not known here";
  } else if (IsWanted(request.map, now_s)) {
    reply.reason = name + " is in use: a tracker is in it or waits for it, or it is being fused";
  } else {
    deleted_[request.map] = maps_.at(request.map).epoch;
    maps_.erase(request.map);
    sizes_.erase(request.map);
    graph_.Remove(request.map);
    just_deleted_.push_back(request.map);
    commands_.push_back(MakeCommand(CommandKind::kForgetMap, request.map));
    reply.ok = true;
  }
  return reply;
}

void Atlas::DecideRegistrations(double now_s) {
  for (Registration& registration : std::exchange(registrations_, {})) {
    if (std::optional<Reply> reply = AnswerRegistration(registration, now_s)) {
      Send(registration.request, std::move(*reply));
    } else {
      registrations_.push_back(std::move(registration));
    }
  }
}

/// Nothing while it is open whether the robot's mapper lives: the one that registers may be its successor, started at
/// once.
std::optional<Reply> Atlas::AnswerRegistration(const Registration& registration, double now_s) {
  const ProcessId mapper = registration.request.sender;
  Reply reply;
  reply.ok = true;
  registered_.insert(mapper);
  Robot& robot = robots_[mapper.robot()];
  if (robot.mapper == mapper) return reply;
  const bool stands_by = registration.request.argument == kStandbyState;
  if (stands_by && HasMapper(mapper.robot(), now_s)) {
    AddStandby(mapper);
    return reply;
  }
  if (!robot.mapper.IsValid() || !IsAlive(robot.mapper, now_s)) {
    robot.mapper = mapper;
    robot.adopted = false;
    if (stands_by) Tell(CommandKind::kAppointMapper, mapper.robot(), mapper);
    return reply;
  }
  if (stands_by) {
    AddStandby(mapper);
    return reply;
  }
  if (peers_.at(robot.mapper).last_seen_s <= registration.since_s) return std::nullopt;
  reply.ok = false;
  reply.reason = "robot " + std::to_string(mapper.robot()) + " has a mapper: " + Describe(robot.mapper);
  return reply;
}

void Atlas::OnSignOfLife(ProcessId process, double now_s) {
  const auto [peer, is_new] = peers_.try_emplace(process);
  if (is_new) peer->second.first_seen_s = now_s;
  peer->second.last_seen_s = now_s;
}

void Atlas::OnEpoch(MapId map, Epoch epoch) {
  if (deleted_.count(map) == 1 || Resolve(map) != map) return;
  graph_.AddMap(map);
  Ownership& known = maps_[map];
  if (!known.map.IsValid()) known = Ownership{map, map.robot(), 0, ProcessId()};
  if (epoch <= known.epoch) return;
  known.epoch = epoch;
  const auto robot = robots_.find(
      known.robot);  // an earlier atlas_server granted it; if not to the mapper that we found here, a status will tell
  known.owner = robot != robots_.end() && robot->second.adopted ? robot->second.mapper : ProcessId();
}

void Atlas::Adopt(MapId map, Epoch epoch) {
  deleted_.erase(map);
  OnEpoch(map, epoch);
  const auto adopted = maps_.find(map);
  if (adopted != maps_.end()) Grant(&adopted->second, self_);
}

Epoch Atlas::DeletedEpoch(MapId map) const {
  const auto deleted = deleted_.find(map);
  return deleted == deleted_.end() ? 0 : deleted->second;
}

void Atlas::OnSize(MapId map, size_t keyframes) {
  if (deleted_.count(map) == 0 && Resolve(map) == map) sizes_[map] = keyframes;
}

void Atlas::OnMapperState(const MapperState& state, double now_s) {
  OnSignOfLife(state.process, now_s);
  idle_[state.process] = state.idle && state.queue_depth == 0 && !state.is_refining;
}

void Atlas::OnStatus(const ProcessStatus& status, double now_s) {
  if (status.process == self_) return;
  NoteTime(now_s);
  OnSignOfLife(status.process, now_s);
  peers_[status.process].status = status;
  if (status.role == kTrackerRole) OnTracker(status, now_s);
  const bool owns = status.map.IsValid() && status.epoch > 0 && status.state != kStandbyState;
  if (status.role == kMapperRole && owns) TakeUp(status);
  if (!Listening(now_s)) Decide(now_s);
}

void Atlas::OnTracker(const ProcessStatus& status, double now_s) {
  Tracker& tracker = trackers_[status.process];
  tracker.in = status.map;
  if (tracker.asked_for == status.map) tracker.asked_for = MapId();
  tracker.last_seen_s = now_s;
  // One that is still in a map that was fused before this session has missed that.
  const auto fused = graph_.fused().find(status.map);
  if (fused == graph_.fused().end() || !told_fusions_.insert(status.map).second) return;
  Command command = MakeCommand(CommandKind::kFuseMaps, fused->second.map);
  command.other = status.map;
  command.map_from_other = fused->second.map_from_other;
  commands_.push_back(command);
}

/// A mapper says what it owns. In an epoch that was granted to another, it is wrong.
void Atlas::TakeUp(const ProcessStatus& status) {
  OnEpoch(status.map, status.epoch);
  if (maps_.count(status.map) == 0) return;
  Ownership& map = maps_[status.map];
  if (map.epoch != status.epoch || map.owner.IsValid()) return;
  map.owner = status.process;
  grants_.push_back(map);
}

void Atlas::OnTick(double now_s) {
  NoteTime(now_s);
  if (Listening(now_s)) return;
  for (const Request& request : std::exchange(early_, {})) Handle(request, now_s);
  for (const Request& order : std::exchange(refused_orders_, {})) {
    if (IsForwarded(order.kind)) {
      Forward(order, now_s);
    } else {
      orders_.push_back(order);
    }
  }
  AdoptMappers(now_s);
  Decide(now_s);
}

/// Gives mappers that an earlier atlas_server registered their place back.
void Atlas::AdoptMappers(double now_s) {
  for (const auto& [id, peer] : peers_) {
    if (peer.status.role != kMapperRole || registered_.count(id) == 1 || !IsAlive(id, now_s)) continue;
    Robot& robot = robots_[id.robot()];
    const bool stands_by = peer.status.state == kStandbyState;
    if (stands_by) AddStandby(id);
    if (stands_by && (robot.mapper.IsValid() || HasMapper(id.robot(), now_s))) continue;
    if (robot.mapper.IsValid() && IsAlive(robot.mapper, now_s)) continue;
    const bool owns = peer.status.map.IsValid() && peer.status.epoch > 0 && !stands_by;
    if (!owns && now_s - peer.first_seen_s < kAdoptAfterS) continue;
    robot.mapper = id;
    robot.adopted = true;
    registered_.insert(id);
    if (stands_by) Tell(CommandKind::kAppointMapper, id.robot(), id);
    for (auto& [map, ownership] : maps_) {
      if (ownership.robot == id.robot() && ownership.epoch > 0 && !ownership.owner.IsValid()) ownership.owner = id;
    }
  }
}

void Atlas::Decide(double now_s) {
  DecideRegistrations(now_s);
  for (auto& [id, robot] : robots_) PromoteStandby(&robot, now_s);
  for (const auto& [id, tracker] : trackers_) {
    if (!IsHere(tracker, now_s)) continue;
    Serve(id.robot(), Resolve(tracker.asked_for), now_s);
    Serve(id.robot(), Resolve(tracker.in), now_s);
  }
  PutToRest(now_s);
}

void Atlas::PromoteStandby(Robot* robot, double now_s) {
  if (!robot->mapper.IsValid() || IsAlive(robot->mapper, now_s)) return;
  const auto successor =
      std::find_if(robot->standbys.begin(), robot->standbys.end(), [&](ProcessId id) { return IsAlive(id, now_s); });
  if (successor == robot->standbys.end()) return;
  robot->adopted = false;
  std::swap(robot->mapper, *successor);  // the old one, if it only slept, is a standby from now on
  Tell(CommandKind::kAppointMapper, robot->mapper.robot(), robot->mapper);
}

/// Sees to it that a wanted map has an owner who lives.
void Atlas::Serve(RobotId robot_id, MapId id, double now_s) {
  const auto robot = robots_.find(robot_id);
  const auto map = maps_.find(id);
  if (robot == robots_.end() || map == maps_.end() || robot->second.is_leaving || !robot->second.mapper.IsValid() ||
      !IsAlive(robot->second.mapper, now_s))
    return;
  const ProcessId owner = map->second.owner;
  if (owner.IsValid() && owner != self_ && IsAlive(owner, now_s)) return;
  Grant(&map->second, robot->second.mapper);
}

bool Atlas::IsWanted(MapId map, double now_s) const {
  if (holds_.count(map) == 1) return true;
  return std::any_of(trackers_.begin(), trackers_.end(), [&](const auto& entry) {
    const Tracker& tracker = entry.second;
    return IsHere(tracker, now_s) && (Resolve(tracker.in) == map || Resolve(tracker.asked_for) == map);
  });
}

/// Makes maps dormant that nobody wants, once their mapper has nothing left to do in them.
void Atlas::PutToRest(double now_s) {
  for (auto& [id, map] : maps_) {
    // Whoever was in a map before this process came has as long to be heard of as one that fell silent.
    const bool may_be_wanted = granted_here_.count(id) == 0 && now_s - start_s_ < kGoneS;
    if (map.epoch == 0 || map.owner == self_ || may_be_wanted || IsWanted(id, now_s)) {
      unwanted_since_s_.erase(id);
      continue;
    }
    const double unwanted_s = now_s - unwanted_since_s_.emplace(id, now_s).first->second;
    const auto idle = idle_.find(map.owner);
    const bool is_busy = IsAlive(map.owner, now_s) && idle != idle_.end() && !idle->second;
    if (unwanted_s >= (is_busy ? kDormantAtLastS : kDormantAfterS)) Grant(&map, self_);
  }
}

void Atlas::Activate(RobotId robot, MapId map, MapId other, const Sim3d& map_from_other) {
  Command command = MakeCommand(CommandKind::kActivateMap, map);
  command.other = other;
  command.robot = robot;
  command.map_from_other = map_from_other;
  commands_.push_back(command);
}

void Atlas::LinkMaps(const MapGraph::Link& link) {
  graph_.SetLink(link);
  Command command = MakeCommand(CommandKind::kLinkMaps, link.map);
  command.other = link.other;
  command.map_from_other = link.map_from_other;
  commands_.push_back(command);
}

void Atlas::Hold(MapId id, ProcessId owner, double now_s) {
  const auto map = maps_.find(id);
  if (map == maps_.end() || !IsAlive(owner, now_s)) return;
  holds_[id] = owner;
  if (map->second.owner != owner) Grant(&map->second, owner);
}

void Atlas::Fuse(MapId map, MapId other, const Sim3d& map_from_other) {
  graph_.Merge(map, other, map_from_other);
  maps_.erase(other);
  sizes_.erase(other);
  holds_.erase(other);
  unwanted_since_s_.erase(other);
  told_fusions_.insert(other);
  Command command = MakeCommand(CommandKind::kFuseMaps, map);
  command.other = other;
  command.map_from_other = map_from_other;
  commands_.push_back(command);
}

Command Atlas::MakeCommand(CommandKind kind, MapId map) {
  Command command;
  command.number = ++commands_made_;
  command.sender = self_;
  command.kind = kind;
  command.map = map;
  return command;
}

void Atlas::Grant(Ownership* map, ProcessId owner) {
  granted_here_.insert(map->map);
  if (map->epoch > 0 && owner != self_ && map->owner != self_) ++takeovers_;
  ++map->epoch;
  map->owner = owner;
  grants_.push_back(*map);
  Command command = MakeCommand(CommandKind::kGrantOwnership, map->map);
  command.epoch = map->epoch;
  command.owner = owner;
  commands_.push_back(command);
}

size_t Atlas::SizeOf(MapId map) const {
  const auto size = sizes_.find(map);
  return size == sizes_.end() ? 0 : size->second;
}

bool Atlas::IsActive(MapId map, double now_s) const {
  return !TrackersIn(map, now_s).empty();
}

std::vector<ProcessId> Atlas::TrackersIn(MapId map, double now_s) const {
  std::vector<ProcessId> in;
  for (const auto& [id, tracker] : trackers_) {
    if (IsHere(tracker, now_s) && Resolve(tracker.in) == map) in.push_back(id);
  }
  return in;
}

std::vector<ProcessId> Atlas::TrackersOf(RobotId robot, double now_s) const {
  std::vector<ProcessId> of;
  for (const auto& [id, tracker] : trackers_) {
    if (IsHere(tracker, now_s) && id.robot() == robot) of.push_back(id);
  }
  return of;
}

MapId Atlas::MapOf(ProcessId id) const {
  const auto tracker = trackers_.find(id);
  return tracker == trackers_.end() ? MapId() : Resolve(tracker->second.in);
}

bool Atlas::IsAlive(ProcessId process, double now_s) const {
  if (process == self_) return true;
  const auto peer = peers_.find(process);
  return peer != peers_.end() && now_s - peer->second.last_seen_s <= kAliveS;
}

size_t Atlas::num_pending() const {
  const auto ungranted =
      std::count_if(maps_.begin(), maps_.end(), [](const auto& entry) { return entry.second.epoch == 0; });
  return early_.size() + registrations_.size() + static_cast<size_t>(ungranted);
}

std::vector<Atlas::Ownership> Atlas::TakeGrants() {
  return std::exchange(grants_, {});
}
std::vector<Command> Atlas::TakeCommands() {
  return std::exchange(commands_, {});
}
std::vector<Reply> Atlas::TakeReplies() {
  return std::exchange(replies_, {});
}

}  // namespace portolan
