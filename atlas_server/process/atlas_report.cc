// What the atlas_server tells of itself: lists and the map graph on request, its status, and its report at the end.

#include <nlohmann/json.hpp>

#include "base/hash.h"
#include "process/atlas_process.h"
#include "process/process_report.h"

namespace portolan {
namespace {

nlohmann::json ToJson(const Sim3d& s) {
  return {{"scale", s.scale},
          {"rotation", {s.rotation.x(), s.rotation.y(), s.rotation.z(), s.rotation.w()}},
          {"translation", {s.translation.x(), s.translation.y(), s.translation.z()}}};
}

nlohmann::json ToJson(const JoinRecord& record) {
  nlohmann::json json = {{"kind", record.kind == JoinRecord::Kind::kSwitch ? "switch" : "fusion"},
                         {"robot", record.robot},
                         {"map", ToString(record.map)},
                         {"other", ToString(record.other)},
                         {"keyframe", ToString(record.current)},
                         {"matched", ToString(record.matched)},
                         {"keyframes", record.keyframes},
                         {"seconds", record.done_s - record.decided_s},
                         {"done", record.is_done},
                         {"problem", record.problem}};
  json["map_from_other"] = ToJson(record.map_from_other);
  return json;
}

}  // namespace

Reply AtlasProcess::ListMaps() const {
  nlohmann::json list = nlohmann::json::array();
  for (const auto& [id, ownership] : atlas_.maps()) {
    nlohmann::json entry = {{"map", ToString(id)},
                            {"robot", ownership.robot},
                            // Granted; that of the state is older until the owner changes it.
                            {"epoch", ownership.epoch},
                            {"owner", ToString(ownership.owner)},
                            {"owner_alive", atlas_.IsAlive(ownership.owner, Now())},
                            {"active", atlas_.IsActive(id, Now())}};
    if (const auto figures = shelf_.FiguresOf(id)) {
      entry["state_epoch"] = figures->epoch;
      entry["revision"] = figures->revision;
      entry["keyframes"] = figures->keyframes;
      entry["points"] = figures->points;
    }
    list.push_back(entry);
  }
  Reply reply;
  reply.ok = true;
  reply.text = nlohmann::json{{"maps", list}, {"last", ToString(last_map_)}}.dump();
  return reply;
}

AtlasProcess::Totals AtlasProcess::CountTotals() const {
  Totals totals;
  for (const MapId id : shelf_.Ids()) {
    const MapShelf::Figures figures = *shelf_.FiguresOf(id);
    ++totals.maps;
    totals.keyframes += figures.keyframes;
    totals.points += figures.points;
  }
  return totals;
}

std::map<MapId, MapLabel> AtlasProcess::LabelMaps() const {
  std::map<MapId, MapLabel> labels;
  for (const auto& [id, ownership] : atlas_.maps()) {
    MapLabel& label = labels[id];
    label.robot = ownership.robot;
    label.owner = ownership.owner;
    label.is_active = atlas_.IsActive(id, Now());
    const MapShelf::Figures figures = shelf_.FiguresOf(id).value_or(MapShelf::Figures());
    label.keyframes = figures.revision == 0 ? atlas_.SizeOf(id) : figures.keyframes;
    label.points = figures.points;
  }
  return labels;
}

/// @param format "dot" for Graphviz, else JSON.
Reply AtlasProcess::DescribeGraph(const std::string& format) const {
  Reply reply;
  reply.ok = true;
  reply.text = format == "dot" ? ToDot(atlas_.graph(), LabelMaps()) : portolan::ToJson(atlas_.graph(), LabelMaps());
  return reply;
}

void AtlasProcess::AddOverlaps(nlohmann::json* report) const {
  const MapJoiner::Counters& joined = joiner_.counters();
  (*report)["map_graph"] = nlohmann::json::parse(portolan::ToJson(atlas_.graph(), LabelMaps()));
  (*report)["overlaps"] = {
      {"looked_up", lookups_.keyframes},   {"passed_over", lookups_.passed_over}, {"maps", lookups_.maps},
      {"candidates", lookups_.candidates}, {"consistent", lookups_.consistent},   {"verified", lookups_.verified},
      {"confirmed", lookups_.confirmed},   {"refused", lookups_.refused},         {"found", joined.overlaps},
      {"located", lookups_.located},       {"not_located", lookups_.not_located}};
  (*report)["switches"] = joined.switches;
  (*report)["fusions"] = joined.fusions;
  (*report)["joins"] = nlohmann::json::array();
  for (const JoinRecord& record : joiner_.records()) (*report)["joins"].push_back(ToJson(record));
  (*report)["overlap_refusals"] = nlohmann::json::array();
  for (const OverlapRefusal& refusal : refusals_) {
    (*report)["overlap_refusals"].push_back({{"map", ToString(refusal.map)},
                                             {"keyframe", ToString(refusal.current)},
                                             {"other", ToString(refusal.other)},
                                             {"candidate", ToString(refusal.candidate)},
                                             {"reason", refusal.reason}});
  }
  (*report)["appearance"] = {{"mb", shelf_.appearance_mb()},
                             {"keyframes", shelf_.num_appearances()},
                             {"loads", shelf_.loads()},
                             {"load_failures", shelf_.load_failures()}};
  (*report)["paging"] = {
      {"maps", shelf_.num_paged()}, {"loads", shelf_.map_loads()}, {"load_failures", shelf_.map_load_failures()}};
  (*report)["indexed_keyframes"] = shelf_.indexed_keyframes();
}

void AtlasProcess::OnStatusTimer() {
  PublishFollowers(true);
  if (atlas_.is_standby() && !has_left_) AskForList();
  const Totals totals = CountTotals();
  const MapShelf::Figures last = shelf_.FiguresOf(last_map_).value_or(MapShelf::Figures());
  const bool failing = saver_ && store_failures_ > 0 && !saver_->IsComplete(shelf_.maps());
  status_.Publish(atlas_.is_standby() ? kStandbyState
                  : failing           ? "the store can't be written"
                  : totals.maps == 0  ? "waiting for a map"
                                      : "following",
                  last_map_, last.epoch, last.revision,
                  {{"maps", static_cast<double>(totals.maps)},
                   {"keyframes", static_cast<double>(totals.keyframes)},
                   {"points", static_cast<double>(totals.points)},
                   {"stored_keyframes", static_cast<double>(store_ == nullptr ? 0 : store_->num_keyframes())},
                   {"pending_requests", static_cast<double>(atlas_.num_pending())},
                   {"grants", static_cast<double>(grants_)},
                   {"takeovers", static_cast<double>(atlas_.num_takeovers())},
                   {"swaps", static_cast<double>(succession_.num_swaps())},
                   {"promotions", static_cast<double>(succession_.num_promotions())},
                   {"lag", static_cast<double>(Lag())},
                   {"maps_missing", static_cast<double>(NumMissingMaps())},
                   {"waits_for_store", open_later_ ? 1.0 : 0.0},
                   {"snapshots_sent", static_cast<double>(snapshots_.sent())},
                   {"snapshots_asked", static_cast<double>(snapshots_asked_)},
                   {"store_failures", static_cast<double>(store_failures_)},
                   {"foreign_vocabulary", static_cast<double>(foreign_vocabulary_)},
                   {"lookups", static_cast<double>(lookups_.keyframes)},
                   {"lookup_ms", lookup_ms_},
                   {"overlaps", static_cast<double>(joiner_.counters().overlaps)},
                   {"switches", static_cast<double>(joiner_.counters().switches)},
                   {"fusions", static_cast<double>(joiner_.counters().fusions)},
                   {"joins_refused", static_cast<double>(joiner_.counters().refused)},
                   {"joins_open", static_cast<double>(joiner_.num_open())},
                   {"links", static_cast<double>(atlas_.graph().num_links())},
                   {"appearance_mb", shelf_.appearance_mb()},
                   {"maps_paged", static_cast<double>(shelf_.num_paged())},
                   {"map_loads", static_cast<double>(shelf_.map_loads())},
                   {"map_load_failures", static_cast<double>(shelf_.map_load_failures())},
                   {"events_waiting", static_cast<double>(loop_->depth())},
                   {"events_dropped", static_cast<double>(loop_->dropped())}});
}

int AtlasProcess::Finish() {
  ApplyPending();
  TakeUpFusions();
  PublishDecisions();
  int exit_code = exit_code_;
  if (Status saved = SaveAll(); !saved) {
    spdlog::error("{}", saved.error().message);
    exit_code = kExitFailure;
  }
  if (saver_) DropWhatIsStored();  // and what was fused is deleted
  nlohmann::json report = MakeReport(setup_.options, priority_, times_, *bus_);
  const Totals totals = CountTotals();
  const MapReplica::Counters counters = shelf_.replicas().counters();
  report["maps"] = totals.maps;
  report["keyframes"] = totals.keyframes;
  report["points"] = totals.points;
  report["stored_keyframes"] = store_ == nullptr ? 0 : store_->num_keyframes();
  report["store"] = store_path_;
  report["store_failures"] = store_failures_;
  report["grants"] = grants_;
  report["takeovers"] = atlas_.num_takeovers();
  report["swaps"] = succession_.num_swaps();
  report["promotions"] = succession_.num_promotions();
  report["snapshots_sent"] = snapshots_.sent();
  report["snapshots_failed"] = snapshots_.failed();
  report["snapshots_asked"] = snapshots_asked_;
  report["deltas"] = {{"applied", counters.applied},
                      {"repeated", counters.repeated},
                      {"stale_epoch", counters.stale_epoch},
                      {"gaps", counters.gaps}};
  report["map_hash"] = nlohmann::json::object();
  for (const MapId id : shelf_.Ids()) report["map_hash"][ToString(id)] = FormatHash(shelf_.Measure(id)->hash);
  AddOverlaps(&report);
  if (Status written = WriteReport(setup_.options, report); !written) {
    spdlog::error("{}", written.error().message);
    exit_code = kExitFailure;
  }
  return exit_code;
}

}  // namespace portolan
