#include "atlas/succession.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <utility>

#include "base/hash.h"

namespace portolan {
namespace {

std::optional<CommandKind> AppointmentOf(const std::string& role) {
  if (role == Atlas::kMapperRole) return CommandKind::kAppointMapper;
  if (role == Atlas::kLoopRole) return CommandKind::kAppointLoopCloser;
  if (role == Atlas::kAtlasRole) return CommandKind::kAppointAtlasServer;
  return std::nullopt;
}

double Figure(const ProcessStatus& status, const std::string& name) {
  for (const auto& [figure, value] : status.figures) {
    if (figure == name) return value;
  }
  return 0;
}

bool IsAsFar(const HeldMap& a, const HeldMap& as) {
  return std::pair(a.epoch, a.revision) >= std::pair(as.epoch, as.revision);
}
bool IsAtSameState(const HeldMap& a, const HeldMap& b) {
  return a.epoch == b.epoch && a.revision == b.revision;
}

Error Differs(const HeldMap& before, const HeldMap& standby) {
  return Error{"the standby holds another map " + ToString(before.map) + ": " + ToText(standby) + " in place of " +
               ToText(before)};
}

nlohmann::json ToJson(const HeldMap& held) {
  return {{"epoch", held.epoch},
          {"revision", held.revision},
          {"keyframes", held.keyframes},
          {"points", held.points},
          {"hash", FormatHash(held.hash)}};
}

}  // namespace

std::string DescribeSwap(const std::string& role, RobotId robot, ProcessId from, ProcessId to, double seconds,
                         const std::map<MapId, HeldMap>& before, const std::map<MapId, HeldMap>& after) {
  nlohmann::json maps = nlohmann::json::array();
  for (const auto& [id, held] : before) {
    const auto there = after.find(id);
    if (there == after.end()) continue;
    maps.push_back({{"map", ToString(id)},
                    {"before", ToJson(held)},
                    {"after", ToJson(there->second)},
                    {"same", HasSameContent(held, there->second)}});
  }
  return nlohmann::json{{"role", role},       {"robot", robot},     {"from", ToString(from)},
                        {"to", ToString(to)}, {"seconds", seconds}, {"maps", maps}}
      .dump();
}

void Succession::OnOrder(const Request& order, double now_s) {
  Result<Swap> swap = Begin(order, now_s);
  if (!swap) return atlas_->RefuseAtLast(order, swap.error().message, now_s);
  spdlog::info("swap: {} {} is to leave its place to {}", swap->role, atlas_->Describe(swap->from),
               atlas_->Describe(swap->to));
  if (swap->role == Atlas::kMapperRole) atlas_->SetLeaving(swap->robot, true);
  atlas_->Tell(CommandKind::kDrain, swap->robot, swap->from);
  swaps_.push_back(std::move(*swap));
}

/// The robot is the sender's, if it has a process of the role, or the only one that has.
Result<Succession::Swap> Succession::Begin(const Request& order, double now_s) const {
  Swap swap;
  swap.order = order;
  swap.role = order.argument;
  swap.begun_s = swap.since_s = now_s;
  if (!AppointmentOf(swap.role))
    return Error{"swap of '" + swap.role + "': expected backend_mapper, loop_closer or atlas_server"};
  if (swap.role == Atlas::kAtlasRole) {
    swap.robot = self_.robot();
    swap.from = self_;
  } else {
    const std::set<RobotId> robots = atlas_->RobotsWith(swap.role, now_s);
    if (robots.empty()) return Error{"there is no " + swap.role};
    if (robots.count(order.sender.robot()) == 0 && robots.size() > 1)
      return Error{fmt::format("{} robots have a {}: name one", robots.size(), swap.role)};
    swap.robot = robots.count(order.sender.robot()) == 1 ? order.sender.robot() : *robots.begin();
    swap.from = atlas_->HolderOf(swap.role, swap.robot, now_s);
    if (!swap.from.IsValid())
      return Error{fmt::format("robot {} has no {} that lives; a standby takes its place without being asked",
                               swap.robot, swap.role)};
  }
  const bool is_under_way =
      std::any_of(swaps_.begin(), swaps_.end(), [&](const Swap& s) { return s.from == swap.from; });
  if (is_under_way || leaving_) return Error{"a swap of the " + swap.role + " is under way"};
  const std::vector<ProcessId> standbys = atlas_->StandbysOf(swap.role, swap.robot, now_s);
  Status problem =
      Error{fmt::format("no standby for the {} of robot {}: start one with --standby", swap.role, swap.robot)};
  for (const ProcessId standby : standbys) {
    swap.to = standby;
    problem = CheckStandby(swap);
    if (problem) return swap;
  }
  return problem.error();
}

/// What can be said before the one drains: it is not to stop its work for nothing.
Status Succession::CheckStandby(const Swap& swap) const {
  const ProcessStatus* to = atlas_->StatusOf(swap.to);
  const ProcessStatus* from = swap.from == self_ ? nullptr : atlas_->StatusOf(swap.from);
  if (const double lag = Figure(*to, "lag"); lag > kMaxLag) {
    return Error{
        fmt::format("the standby has not caught up: {} is {:.0f} revisions behind", atlas_->Describe(swap.to), lag)};
  }
  if (Figure(*to, "maps_missing") > 0) {
    return Error{fmt::format("the standby has not caught up: {} lacks {:.0f} maps", atlas_->Describe(swap.to),
                             Figure(*to, "maps_missing"))};
  }
  if (from != nullptr && from->map.IsValid() && from->revision > 0 &&
      (to->map != from->map || to->epoch != from->epoch)) {
    return Error{fmt::format("the standby has not caught up: {} follows map {} in epoch {}, not map {} in epoch {}",
                             atlas_->Describe(swap.to), ToString(to->map), to->epoch, ToString(from->map),
                             from->epoch)};
  }
  if (swap.role != Atlas::kMapperRole) return Ok{};
  for (const Atlas::Ownership& map : atlas_->MapsOf(swap.from)) {
    if (atlas_->IsHeld(map.map))
      return Error{"map " + ToString(map.map) + " is being fused: ask again when that is done"};
  }
  return Ok{};
}

void Succession::OnReport(const Request& report, double now_s) {
  for (auto swap = swaps_.begin(); swap != swaps_.end(); ++swap) {
    if (report.sender != swap->from && report.sender != swap->to) continue;
    if (report.kind == "drained") swap->is_drained = swap->is_drained || report.sender == swap->from;
    if (report.kind == "holds_map") {
      const Result<HeldMap> held = ParseHeldMap(report.map, report.argument);
      if (!held) return spdlog::warn("of {}: {}", ToString(report.sender), held.error().message);
      HeldMaps& maps = report.sender == swap->from       ? swap->before
                       : swap->stage == Stage::kDraining ? swap->waiting
                                                         : swap->after;
      maps[report.map] = *held;
    }
    if (Continue(&*swap, now_s)) swaps_.erase(swap);
    return;
  }
}

void Succession::OnTick(double now_s) {
  for (auto swap = swaps_.begin(); swap != swaps_.end();)
    swap = Continue(&*swap, now_s) ? swaps_.erase(swap) : std::next(swap);
  FillPlaces(now_s);
}

bool Succession::Continue(Swap* swap, double now_s) {
  if (swap->stage == Stage::kDraining) return ContinueDraining(swap, now_s);
  const bool told = std::all_of(swap->before.begin(), swap->before.end(), [&](const auto& entry) {
    const auto after = swap->after.find(entry.first);
    return entry.second.revision == 0 || (after != swap->after.end() && after->second.epoch > entry.second.epoch);
  });
  if (told) {
    Finish(*swap, now_s);
    return true;
  }
  if (now_s - swap->since_s < kTakeOverS && atlas_->IsAlive(swap->to, now_s)) return false;
  Refuse(swap->order,
         "the place passed on to " + atlas_->Describe(swap->to) + ", which has not said since that it holds the maps");
  return true;
}

bool Succession::ContinueDraining(Swap* swap, double now_s) {
  if (!atlas_->IsAlive(swap->from, now_s)) {
    if (swap->role == Atlas::kMapperRole) atlas_->SetLeaving(swap->robot, false);
    Refuse(swap->order, atlas_->Describe(swap->from) + " died while it drained; a standby takes its place");
    return true;
  }
  const Result<bool> enough =
      atlas_->IsAlive(swap->to, now_s) ? HoldsEnough(swap) : Result<bool>(Error{"the standby died"});
  if (!enough || (!*enough && now_s - swap->since_s > kDrainS)) {
    const bool is_drained = swap->is_drained || swap->from == self_;
    const std::string who = is_drained ? "the standby " + atlas_->Describe(swap->to) + " did not catch up"
                                       : atlas_->Describe(swap->from) + " did not end what it had begun";
    CallOff(*swap, enough ? fmt::format("{} within {:.0f} s; all is as it was", who, kDrainS) : enough.error().message);
    return true;
  }
  if (!*enough) return false;
  if (swap->from == self_) {
    leaving_ = *swap;
    return true;
  }
  PassOn(swap, now_s);
  return swap->role == Atlas::kLoopRole;
}

Result<bool> Succession::HoldsEnough(Swap* swap) const {
  if (swap->role == Atlas::kAtlasRole) return HoldsMapsOfAtlas(swap);
  if (!swap->is_drained) return false;
  if (swap->role == Atlas::kMapperRole) return HoldsMapsOfMapper(*swap);
  for (const auto& [id, held] : swap->before) {  // its maps grow on while it drains
    const auto there = swap->waiting.find(id);
    if (there == swap->waiting.end() || !IsAsFar(there->second, held)) return false;
    if (IsAtSameState(there->second, held) && !HasSameContent(there->second, held)) return Differs(held, there->second);
  }
  return true;
}

Result<bool> Succession::HoldsMapsOfMapper(const Swap& swap) const {
  for (const Atlas::Ownership& map : atlas_->MapsOf(swap.from)) {
    const auto held = swap.before.find(map.map);
    if (held == swap.before.end()) return false;
    if (held->second.revision == 0) continue;  // not begun
    const auto there = swap.waiting.find(map.map);
    if (there == swap.waiting.end() || !IsAtSameState(there->second, held->second)) return false;
    if (!HasSameContent(there->second, held->second)) return Differs(held->second, there->second);
  }
  return true;
}

/// Once it held a map as it was here at that moment, it misses nothing that comes after. Dormant maps are in the file,
/// if that is one.
Result<bool> Succession::HoldsMapsOfAtlas(Swap* swap) const {
  const ProcessStatus* to = atlas_->StatusOf(swap->to);
  const bool has_same_file = to != nullptr && Figure(*to, "waits_for_store") > 0;
  for (const auto& [id, map] : atlas_->maps()) {
    if (swap->before.count(id) == 1 || (has_same_file && map.owner == self_)) continue;
    const std::optional<HeldMap> held = measure_(id);
    if (!held || held->revision == 0) continue;
    const auto there = swap->waiting.find(id);
    if (there == swap->waiting.end() || !IsAtSameState(there->second, *held)) return false;
    if (!HasSameContent(there->second, *held)) return Differs(*held, there->second);
    swap->before[id] = *held;
    swap->after[id] = there->second;
  }
  return true;
}

void Succession::PassOn(Swap* swap, double now_s) {
  swap->stage = Stage::kTakingOver;
  swap->since_s = now_s;
  if (swap->role == Atlas::kMapperRole) {
    HeldMaps passing;  // of what it told some may be dormant by now
    for (const Atlas::Ownership& map : atlas_->MapsOf(swap->from)) passing[map.map] = swap->before.at(map.map);
    swap->before = std::move(passing);
    atlas_->SetLeaving(swap->robot, false);
    atlas_->ReplaceMapper(swap->robot, swap->to);
    return;
  }
  atlas_->Tell(*AppointmentOf(swap->role), swap->robot, swap->to);
  swap->after = swap->waiting;
  Finish(*swap, now_s);
}

void Succession::CallOff(const Swap& swap, const std::string& reason) {
  if (swap.role == Atlas::kMapperRole) atlas_->SetLeaving(swap.robot, false);
  atlas_->Tell(*AppointmentOf(swap.role), swap.robot, swap.from);
  Refuse(swap.order, reason);
}

void Succession::Leave(double now_s) {
  const Swap swap = *std::exchange(leaving_, std::nullopt);
  atlas_->Tell(CommandKind::kAppointAtlasServer, swap.robot, swap.to);
  Finish(swap, now_s);
}

void Succession::Stay(const std::string& reason) {
  CallOff(*std::exchange(leaving_, std::nullopt), reason);
}

void Succession::Finish(const Swap& swap, double now_s) {
  ++swaps_done_;
  Reply reply;
  reply.ok = true;
  reply.text = DescribeSwap(swap.role, swap.robot, swap.from, swap.to, now_s - swap.begun_s, swap.before, swap.after);
  spdlog::info("swap done: {}", reply.text);
  atlas_->Answer(swap.order, std::move(reply));
}

void Succession::Refuse(const Request& order, const std::string& reason) {
  Reply reply;
  reply.reason = reason;
  atlas_->Answer(order, std::move(reply));
}

/// A loop_closer needs no grant, and only one may propose: of those that stand by one is appointed, once none works.
void Succession::FillPlaces(double now_s) {
  for (const RobotId robot : atlas_->RobotsWith(Atlas::kLoopRole, now_s)) {
    if (atlas_->HolderOf(Atlas::kLoopRole, robot, now_s).IsValid()) {
      appointed_s_.erase(robot);
      continue;
    }
    const std::vector<ProcessId> standbys = atlas_->StandbysOf(Atlas::kLoopRole, robot, now_s);
    // One that was here before this atlas_server has as long to be heard of as a mapper.
    if (standbys.empty() || now_s - atlas_->FirstSeen(standbys.front()) < Atlas::kAdoptAfterS) continue;
    const auto [appointed, is_new] = appointed_s_.try_emplace(robot, now_s);
    if (!is_new && now_s - appointed->second < kAppointAgainS) continue;
    if (is_new) {
      ++promotions_;
      spdlog::info("robot {}: {} has the place of its loop_closer", robot, atlas_->Describe(standbys.front()));
    }
    appointed->second = now_s;
    atlas_->Tell(CommandKind::kAppointLoopCloser, robot, standbys.front());
  }
}

}  // namespace portolan
