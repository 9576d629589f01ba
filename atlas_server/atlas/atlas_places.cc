// Who has which place: mappers, loop_closers and atlas_servers, and who waits for one.

#include <algorithm>
#include <limits>

#include "atlas/atlas.h"

namespace portolan {

void Atlas::Promote(double now_s) {
  is_standby_ = false;
  start_s_ = now_s - kListenS;
  commands_.clear();  // what the other has said and stored already
  grants_.clear();
}

void Atlas::Follow(const std::vector<Ownership>& ownerships) {
  for (const Ownership& followed : ownerships) {
    if (deleted_.count(followed.map) == 1 || Resolve(followed.map) != followed.map) continue;
    Ownership& known = maps_[followed.map];
    if (followed.epoch >= known.epoch) known = followed;
    graph_.AddMap(followed.map);
  }
}

void Atlas::FollowDeletion(MapId map) {
  const auto known = maps_.find(map);
  deleted_[map] = known == maps_.end() ? 0 : known->second.epoch;
  maps_.erase(map);
  sizes_.erase(map);
  graph_.Remove(map);
}

void Atlas::Tell(CommandKind kind, RobotId robot, ProcessId process) {
  Command command = MakeCommand(kind, MapId());
  command.robot = robot;
  command.owner = process;
  commands_.push_back(command);
}

void Atlas::AddStandby(ProcessId mapper) {
  std::vector<ProcessId>& standbys = robots_[mapper.robot()].standbys;
  if (std::find(standbys.begin(), standbys.end(), mapper) == standbys.end()) standbys.push_back(mapper);
}

/// Registered or not.
bool Atlas::HasMapper(RobotId robot, double now_s) const {
  return std::any_of(peers_.begin(), peers_.end(), [&](const auto& entry) {
    const ProcessStatus& status = entry.second.status;
    return entry.first.robot() == robot && status.role == kMapperRole && status.state != kStandbyState &&
           IsAlive(entry.first, now_s);
  });
}

void Atlas::ReplaceMapper(RobotId robot_id, ProcessId to) {
  Robot& robot = robots_[robot_id];
  for (const Ownership& owned : MapsOf(robot.mapper)) Grant(&maps_.at(owned.map), to);
  robot.mapper = to;
  robot.adopted = false;
  robot.standbys.erase(std::remove(robot.standbys.begin(), robot.standbys.end(), to), robot.standbys.end());
  Tell(CommandKind::kAppointMapper, robot_id, to);
}

ProcessId Atlas::HolderOf(const std::string& role, RobotId robot, double now_s) const {
  if (role == kMapperRole) {
    const auto known = robots_.find(robot);
    return known != robots_.end() && IsAlive(known->second.mapper, now_s) ? known->second.mapper : ProcessId();
  }
  for (const auto& [id, peer] : peers_) {
    const bool is_its = role == kAtlasRole || id.robot() == robot;
    if (is_its && peer.status.role == role && peer.status.state != kStandbyState && IsAlive(id, now_s)) return id;
  }
  return ProcessId();
}

std::vector<ProcessId> Atlas::StandbysOf(const std::string& role, RobotId robot, double now_s) const {
  std::vector<ProcessId> standbys;
  for (const auto& [id, peer] : peers_) {
    const bool is_its = role == kAtlasRole || id.robot() == robot;
    if (is_its && peer.status.role == role && peer.status.state == kStandbyState && IsAlive(id, now_s))
      standbys.push_back(id);
  }
  return standbys;
}

std::set<RobotId> Atlas::RobotsWith(const std::string& role, double now_s) const {
  std::set<RobotId> robots;
  for (const auto& [id, peer] : peers_) {
    if (peer.status.role == role && IsAlive(id, now_s)) robots.insert(id.robot());
  }
  return robots;
}

std::vector<Atlas::Ownership> Atlas::MapsOf(ProcessId owner) const {
  std::vector<Ownership> owned;
  for (const auto& [id, map] : maps_) {
    if (map.owner == owner && map.epoch > 0) owned.push_back(map);
  }
  return owned;
}

const ProcessStatus* Atlas::StatusOf(ProcessId process) const {
  const auto peer = peers_.find(process);
  return peer == peers_.end() || peer->second.status.role.empty() ? nullptr : &peer->second.status;
}

double Atlas::FirstSeen(ProcessId process) const {
  const auto peer = peers_.find(process);
  return peer == peers_.end() ? std::numeric_limits<double>::infinity() : peer->second.first_seen_s;
}

std::string Atlas::Describe(ProcessId process) const {
  const std::string name = "process " + ToString(process);
  const ProcessStatus* status = StatusOf(process);
  if (status == nullptr) return name;
  return name + " (pid " + std::to_string(status->pid) + " on host '" + status->host + "')";
}

}  // namespace portolan
