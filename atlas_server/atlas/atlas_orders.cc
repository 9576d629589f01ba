// What users order a robot's tracker or loop_closer to do. It is passed on where somebody is there who obeys, and
// refused with the reason where not.

#include <fmt/format.h>

#include <algorithm>
#include <charconv>

#include "atlas/atlas.h"

namespace portolan {
namespace {

/// A figure of a status that is 0 or 1; `otherwise` where the process tells none of that name.
bool Tells(const ProcessStatus& status, const std::string& name, bool otherwise) {
  for (const auto& [figure, value] : status.figures) {
    if (figure == name) return value != 0;
  }
  return otherwise;
}

const std::map<std::string, CommandKind>& ForwardedKinds() {
  static const std::map<std::string, CommandKind> kForwarded = {
      {"start_map", CommandKind::kNewMap},   {"pause", CommandKind::kPause},
      {"resume", CommandKind::kResume},      {"localize_only", CommandKind::kLocalizeOnly},
      {"map_again", CommandKind::kMapAgain}, {"global_ba", CommandKind::kAdjustMap}};
  return kForwarded;
}

}  // namespace

bool Atlas::IsForwarded(const std::string& kind) {
  return ForwardedKinds().count(kind) == 1;
}

void Atlas::Forward(const Request& request, double now_s) {
  const CommandKind kind = ForwardedKinds().at(request.kind);
  const bool is_of_map = kind == CommandKind::kAdjustMap;
  const MapId map = is_of_map ? Resolve(request.map) : MapId();
  const Result<RobotId> robot = is_of_map ? AdjusterOf(map, now_s) : RobotOf(request, now_s);
  const Status obeys = !robot ? Status(robot.error()) : is_of_map ? Status(Ok{}) : WouldObey(kind, *robot, now_s);
  if (!obeys) return RefuseAtLast(request, obeys.error().message, now_s);
  Reply reply;
  reply.ok = true;
  Command command = MakeCommand(kind, map);
  if (is_of_map) {
    reply.text = fmt::format("the loop_closer of robot {} adjusts map {}", *robot, ToString(map));
  } else {
    command.robot = *robot;
  }
  commands_.push_back(command);
  Answer(request, std::move(reply));
}

/// The robot whose loop_closer can adjust the map: that of its owner.
Result<RobotId> Atlas::AdjusterOf(MapId id, double now_s) const {
  const auto map = maps_.find(id);
  if (map == maps_.end()) return Error{"map " + ToString(id) + " is not known here"};
  const ProcessId owner = map->second.owner;
  if (owner == self_ || !IsAlive(owner, now_s))
    return Error{"map " + ToString(id) + " is dormant: no mapper could change it"};
  if (HolderOf(kLoopRole, owner.robot(), now_s).IsValid()) return owner.robot();
  return Error{fmt::format("robot {}, whose mapper has map {}, has no loop_closer", owner.robot(), ToString(id))};
}

Status Atlas::WouldObey(CommandKind kind, RobotId robot, double now_s) const {
  Status obeys = Error{fmt::format("robot {} has no tracker", robot)};
  // For a moment there may be two: one that ended and one that came in its place.
  for (const ProcessId id : TrackersOf(robot, now_s)) {
    const ProcessStatus* status = StatusOf(id);
    if (status == nullptr) continue;
    obeys = Ok{};
    if (!Tells(*status, "takes_orders", true)) {
      obeys = Error{fmt::format("robot {} is at no frames: its tracker has not begun, or is at its end", robot)};
    } else if (kind == CommandKind::kActivateMap && Tells(*status, "paused", false)) {
      obeys = Error{fmt::format("robot {} is paused: 'portolan resume' first", robot)};
    } else if (kind == CommandKind::kNewMap && Tells(*status, "localization_only", false)) {
      obeys = Error{fmt::format("robot {} localises only: 'portolan localize-only off' first", robot)};
    } else if (kind == CommandKind::kNewMap && !MapOf(id).IsValid()) {
      obeys = Error{fmt::format("robot {} is in no map: it begins one by itself", robot)};
    }
    if (obeys) return obeys;
  }
  return obeys;
}

Result<RobotId> Atlas::RobotOf(const Request& request, double now_s) const {
  if (const std::string& argument = request.argument; !argument.empty()) {
    RobotId robot = 0;
    const auto [end, error] = std::from_chars(argument.data(), argument.data() + argument.size(), robot);
    if (error != std::errc() || end != argument.data() + argument.size())
      return Error{"'" + argument + "' is no robot's number"};
    if (TrackersOf(robot, now_s).empty()) return Error{"robot " + argument + " has no tracker"};
    return robot;
  }
  if (!TrackersOf(request.sender.robot(), now_s).empty()) return request.sender.robot();
  std::set<RobotId> robots;
  for (const auto& [id, tracker] : trackers_) {
    if (IsHere(tracker, now_s)) robots.insert(id.robot());
  }
  if (robots.size() == 1) return *robots.begin();
  return Error{robots.empty() ? "there is no tracker" : fmt::format("there are {} robots: name one", robots.size())};
}

}  // namespace portolan
