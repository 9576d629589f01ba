#include "atlas/atlas.h"

#include <algorithm>
#include <utility>

namespace portolan {
namespace {

constexpr size_t kMaxAnswers = 1024;  // remembered: a request is repeated for seconds, not for hours
constexpr size_t kMaxEarly = 256;     // requests while listening; whoever is not answered asks again
constexpr const char* kStandby = "standby";
constexpr const char* kMapperRole = "backend_mapper";
constexpr const char* kTrackerRole = "frontend_tracker";

}  // namespace

void Atlas::Restore(const std::vector<Ownership>& ownerships) {
  for (const Ownership& ownership : ownerships) maps_[ownership.map] = ownership;
}

void Atlas::OnRequest(const Request& request, double now_s) {
  OnSignOfLife(request.sender, now_s);
  if (Listening(now_s)) {
    const bool repeated =
        std::any_of(early_.begin(), early_.end(), [&](const Request& early) { return early.id == request.id; });
    if (!repeated && early_.size() < kMaxEarly) early_.push_back(request);
    return;
  }
  Answer(request, now_s);
  Decide(now_s);
}

void Atlas::Answer(const Request& request, double now_s) {
  const auto before = answers_.find(request.id);
  if (before != answers_.end()) {
    replies_.push_back(before->second);
    return;
  }
  if (request.kind == "new_map") return Send(request, AnswerNewMap(request));
  if (request.kind == "register_mapper") {
    const bool waits = std::any_of(registrations_.begin(), registrations_.end(),
                                   [&](const auto& r) { return r.request.id == request.id; });
    if (!waits) registrations_.push_back({request, now_s});
    return;
  }
  Reply refusal;
  refusal.reason = "unknown request '" + request.kind + "': expected new_map, register_mapper, list_maps or save";
  Send(request, std::move(refusal));
}

void Atlas::Send(const Request& request, Reply reply) {
  reply.id = request.id;
  reply.sender = self_;
  answers_[reply.id] = reply;
  answer_order_.push_back(reply.id);
  replies_.push_back(std::move(reply));
  if (answer_order_.size() <= kMaxAnswers) return;
  answers_.erase(answer_order_.front());
  answer_order_.pop_front();
}

Reply Atlas::AnswerNewMap(const Request& request) {
  Reply reply;
  if (!request.map.IsValid()) {
    reply.reason = "new_map without the map's id";
    return reply;
  }
  Ownership& map = maps_[request.map];
  if (!map.map.IsValid()) map = Ownership{request.map, request.sender.robot(), 0, ProcessId()};
  robots_[request.sender.robot()].asked_for = request.map;
  reply.ok = true;
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
  if (!robot.mapper.IsValid() || !IsAlive(robot.mapper, now_s)) {
    robot.mapper = mapper;
    robot.adopted = false;
    return reply;
  }
  if (registration.request.argument == kStandby) {
    robot.standbys.push_back(mapper);
    return reply;
  }
  if (peers_.at(robot.mapper).last_seen_s <= registration.since_s) return std::nullopt;
  reply.ok = false;
  reply.reason = "robot " + std::to_string(mapper.robot()) + " has a mapper: " + Describe(robot.mapper);
  return reply;
}

std::string Atlas::Describe(ProcessId process) const {
  const auto peer = peers_.find(process);
  const std::string name = "process " + ToString(process);
  if (peer == peers_.end() || peer->second.status.role.empty()) return name;
  const ProcessStatus& status = peer->second.status;
  return name + " (pid " + std::to_string(status.pid) + " on host '" + status.host + "')";
}

void Atlas::OnSignOfLife(ProcessId process, double now_s) {
  const auto [peer, is_new] = peers_.try_emplace(process);
  if (is_new) peer->second.first_seen_s = now_s;
  peer->second.last_seen_s = now_s;
}

void Atlas::OnEpoch(MapId map, Epoch epoch) {
  Ownership& known = maps_[map];
  if (!known.map.IsValid()) known = Ownership{map, map.robot(), 0, ProcessId()};
  if (epoch <= known.epoch) return;
  known.epoch = epoch;
  const auto robot = robots_.find(
      known.robot);  // an earlier atlas_server granted it; if not to the mapper that we found here, a status will tell
  known.owner = robot != robots_.end() && robot->second.adopted ? robot->second.mapper : ProcessId();
}

void Atlas::OnStatus(const ProcessStatus& status, double now_s) {
  if (status.process == self_) return;
  OnSignOfLife(status.process, now_s);
  peers_[status.process].status = status;
  if (status.role == kTrackerRole) robots_[status.process.robot()].tracked = status.map;
  if (status.role == kMapperRole && status.map.IsValid() && status.epoch > 0) TakeUp(status);
  if (!Listening(now_s)) Decide(now_s);
}

/// A mapper says what it owns. In an epoch that was granted to another, it is wrong.
void Atlas::TakeUp(const ProcessStatus& status) {
  OnEpoch(status.map, status.epoch);
  Ownership& map = maps_[status.map];
  if (map.epoch != status.epoch || map.owner.IsValid()) return;
  map.owner = status.process;
  grants_.push_back(map);
}

void Atlas::OnTick(double now_s) {
  if (Listening(now_s)) return;
  for (const Request& request : std::exchange(early_, {})) Answer(request, now_s);
  AdoptMappers(now_s);
  Decide(now_s);
}

/// Gives mappers that an earlier atlas_server registered their place back.
void Atlas::AdoptMappers(double now_s) {
  for (const auto& [id, peer] : peers_) {
    if (peer.status.role != kMapperRole || registered_.count(id) == 1 || !IsAlive(id, now_s)) continue;
    Robot& robot = robots_[id.robot()];
    if (robot.mapper.IsValid() && IsAlive(robot.mapper, now_s)) continue;
    const bool owns = peer.status.map.IsValid() && peer.status.epoch > 0;
    if (!owns && now_s - peer.first_seen_s < kAdoptAfterS) continue;
    robot.mapper = id;
    robot.adopted = true;
    registered_.insert(id);
    for (auto& [map, ownership] : maps_) {
      if (ownership.robot == id.robot() && ownership.epoch > 0 && !ownership.owner.IsValid()) ownership.owner = id;
    }
  }
}

void Atlas::Decide(double now_s) {
  DecideRegistrations(now_s);
  for (auto& [id, robot] : robots_) {
    PromoteStandby(&robot, now_s);
    if (!robot.mapper.IsValid() || !IsAlive(robot.mapper, now_s)) continue;
    Serve(robot, robot.asked_for, now_s);
    Serve(robot, robot.tracked, now_s);
  }
}

void Atlas::PromoteStandby(Robot* robot, double now_s) {
  if (!robot->mapper.IsValid() || IsAlive(robot->mapper, now_s)) return;
  const auto successor =
      std::find_if(robot->standbys.begin(), robot->standbys.end(), [&](ProcessId id) { return IsAlive(id, now_s); });
  if (successor == robot->standbys.end()) return;
  robot->adopted = false;
  std::swap(robot->mapper, *successor);  // the old one, if it only slept, is a standby from now on
}

/// Sees to it that a wanted map has an owner who lives.
void Atlas::Serve(const Robot& robot, MapId id, double now_s) {
  const auto map = maps_.find(id);
  if (map == maps_.end()) return;
  if (map->second.owner.IsValid() && IsAlive(map->second.owner, now_s)) return;
  Grant(&map->second, robot.mapper);
}

void Atlas::Grant(Ownership* map, ProcessId owner) {
  if (map->epoch > 0) ++takeovers_;
  ++map->epoch;
  map->owner = owner;
  grants_.push_back(*map);
  Command command;
  command.number = ++commands_made_;
  command.sender = self_;
  command.kind = CommandKind::kGrantOwnership;
  command.map = map->map;
  command.epoch = map->epoch;
  command.owner = owner;
  commands_.push_back(command);
}

bool Atlas::IsAlive(ProcessId process, double now_s) const {
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
