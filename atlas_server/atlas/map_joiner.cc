#include "atlas/map_joiner.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>

namespace portolan {
namespace {

constexpr size_t kMaxRecords = 1000;  // kept for the report

/// (feature of a keyframe, landmark of the other side) by pairs (own landmark, landmark of the other side).
std::vector<std::pair<uint32_t, MapPointId>> FeaturesOf(const KeyFrame& keyframe,
                                                        const std::vector<std::pair<MapPointId, MapPointId>>& pairs) {
  std::map<MapPointId, MapPointId> other_of(pairs.begin(), pairs.end());
  std::vector<std::pair<uint32_t, MapPointId>> seen;
  const std::vector<MapPointId> landmarks = keyframe.landmarks.ByFeature();
  for (uint32_t feature = 0; feature < landmarks.size(); ++feature) {
    const auto pair = other_of.find(landmarks[feature]);
    if (landmarks[feature].IsValid() && pair != other_of.end()) seen.emplace_back(feature, pair->second);
  }
  return seen;
}

}  // namespace

LoopClosure ToLoopClosure(const DetectedOverlap& overlap, const Map& map, const Map& other_map) {
  LoopClosure loop;
  if (overlap.map == other_map.id()) {
    loop.current = overlap.current;
    loop.matched = overlap.matched;
    loop.current_from_matched = overlap.place.query_from_candidate;
    loop.seen = overlap.place.seen;
    loop.merges = overlap.place.matches;
    return loop;
  }
  loop.current = overlap.matched;
  loop.matched = overlap.current;
  loop.current_from_matched = overlap.place.query_from_candidate.Inverse();
  for (const auto& [query, candidate] : overlap.place.matches) {
    if (map.FindPoint(query) != nullptr && other_map.FindPoint(candidate) != nullptr)
      loop.merges.emplace_back(candidate, query);
  }
  if (const KeyFrame* current = other_map.FindKeyFrame(loop.current)) loop.seen = FeaturesOf(*current, loop.merges);
  return loop;
}

bool MapJoiner::IsBusy(MapId map) const {
  return std::any_of(proposals_.begin(), proposals_.end(),
                     [map](const Proposal& p) { return p.map == map || p.other == map; });
}

bool MapJoiner::IsFusing(MapId map) const {
  return std::any_of(proposals_.begin(), proposals_.end(), [map](const Proposal& p) {
    return p.stage != Stage::kSwitching && (p.map == map || p.other == map);
  });
}

bool MapJoiner::IsBlocked(MapId map, MapId other) const {
  const auto blocked = blocked_until_.find({map, other});
  const auto count = keyframes_.find(map);
  return blocked != blocked_until_.end() && (count == keyframes_.end() ? 0 : count->second) < blocked->second;
}

/// From either of the two, for some keyframes of its own.
void MapJoiner::Block(MapId map, MapId other) {
  blocked_until_[{map, other}] = keyframes_[map] + static_cast<uint64_t>(options_.retry_keyframes);
  blocked_until_[{other, map}] = keyframes_[other] + static_cast<uint64_t>(options_.retry_keyframes);
}

bool MapJoiner::WantsOverlap(RobotId robot, MapId map, MapId other, double now_s) const {
  const bool has_proposal =
      std::any_of(proposals_.begin(), proposals_.end(), [&](const Proposal& p) { return p.robot == robot; });
  if (has_proposal || IsBusy(map) || IsBusy(other) || IsBlocked(map, other) || atlas_->SizeOf(other) == 0) return false;
  // A map that was begun beside another overlaps it, that is known: the camera has left the other on purpose.
  const auto link = atlas_->graph().FindLink(map, other);
  const bool is_small = atlas_->SizeOf(map) <= static_cast<size_t>(options_.switch_keyframes);
  return !(link && link->origin == MapGraph::Origin::kNewMap && is_small && !atlas_->IsActive(other, now_s));
}

void MapJoiner::OnOverlap(RobotId robot, const DetectedOverlap& overlap, double now_s) {
  if (!WantsOverlap(robot, overlap.map, overlap.other, now_s)) return;
  ++counters_.overlaps;
  atlas_->LinkMaps({overlap.other, overlap.map, overlap.other_from_map, MapGraph::Origin::kOverlap});
  const bool other_is_active = atlas_->IsActive(overlap.other, now_s);
  const size_t size = atlas_->SizeOf(overlap.map), other_size = atlas_->SizeOf(overlap.other);
  if (!other_is_active && size > static_cast<size_t>(options_.switch_keyframes)) return Switch(robot, overlap, now_s);
  // Of two maps in which robots are the larger one stays.
  const bool goes = !other_is_active || std::make_pair(size, overlap.other) <= std::make_pair(other_size, overlap.map);
  BeginFusion(robot, goes ? overlap.other : overlap.map, goes ? overlap.map : overlap.other, overlap, now_s);
}

void MapJoiner::Switch(RobotId robot, const DetectedOverlap& overlap, double now_s) {
  Proposal proposal;
  proposal.robot = robot;
  proposal.since_s = now_s;
  proposal.map = overlap.other;
  proposal.other = overlap.map;
  proposal.map_from_other = overlap.other_from_map;
  JoinRecord& record = proposal.record;
  record.kind = JoinRecord::Kind::kSwitch;
  record.robot = robot;
  record.map = proposal.map;
  record.other = proposal.other;
  record.current = overlap.current;
  record.matched = overlap.matched;
  record.keyframes = atlas_->SizeOf(overlap.map);
  record.map_from_other = overlap.other_from_map;
  record.decided_s = now_s;
  atlas_->Activate(robot, proposal.map, proposal.other, proposal.map_from_other);
  spdlog::info("robot {} is to switch from map {} ({} keyframes) to map {}: {} sees the place of {}", robot,
               ToString(proposal.other), record.keyframes, ToString(proposal.map), ToString(overlap.current),
               ToString(overlap.matched));
  proposals_.push_back(std::move(proposal));
}

void MapJoiner::BeginFusion(RobotId robot, MapId map, MapId other, const DetectedOverlap& overlap, double now_s) {
  Proposal proposal;
  proposal.robot = robot;
  proposal.stage = Stage::kGathering;
  proposal.since_s = now_s;
  proposal.map = map;
  proposal.other = other;
  proposal.map_from_other = map == overlap.other ? overlap.other_from_map : overlap.other_from_map.Inverse();
  proposal.detected = overlap;
  JoinRecord& record = proposal.record;
  record.kind = JoinRecord::Kind::kFusion;
  record.robot = robot;
  record.map = map;
  record.other = other;
  record.current = overlap.current;
  record.matched = overlap.matched;
  record.keyframes = atlas_->SizeOf(overlap.map);
  record.map_from_other = proposal.map_from_other;
  record.decided_s = now_s;
  proposals_.push_back(std::move(proposal));
  spdlog::info("map {} ({} keyframes) is to go into map {} ({} keyframes): {} sees the place of {}", ToString(other),
               atlas_->SizeOf(other), ToString(map), atlas_->SizeOf(map), ToString(overlap.current),
               ToString(overlap.matched));
  Gather(&proposals_.back(), now_s);
}

/// Of a fusion's two maps one mapper is to be the owner: that of the map that stays, if a robot is in it, else that of
/// the other.
void MapJoiner::Gather(Proposal* proposal, double now_s) {
  const auto owner_of = [&](MapId id) {
    const auto map = atlas_->maps().find(id);
    const bool lives =
        map != atlas_->maps().end() && map->second.owner != self_ && atlas_->IsAlive(map->second.owner, now_s);
    return lives ? map->second.owner : ProcessId();
  };
  const MapId first = atlas_->IsActive(proposal->map, now_s) ? proposal->map : proposal->other;
  const MapId second = first == proposal->map ? proposal->other : proposal->map;
  const ProcessId owner = owner_of(first).IsValid() ? owner_of(first) : owner_of(second);
  if (!owner.IsValid()) return;  // until a mapper is there, or patience ends
  proposal->owner = owner;
  atlas_->Hold(proposal->map, owner, now_s);
  atlas_->Hold(proposal->other, owner, now_s);
}

Status MapJoiner::Order(const Request& order, RobotId robot, MapId map, double now_s) {
  const std::vector<ProcessId> trackers = atlas_->TrackersOf(robot, now_s);
  if (trackers.empty()) return Error{fmt::format("robot {} has no tracker", robot)};
  if (atlas_->maps().count(map) == 0) return Error{"map " + ToString(map) + " is not known here"};
  if (atlas_->SizeOf(map) == 0) return Error{"map " + ToString(map) + " has no keyframes"};
  const MapId current = atlas_->MapOf(trackers.back());
  if (current == map) return Error{fmt::format("robot {} is in map {} already", robot, ToString(map))};
  for (const Proposal& p : proposals_) {
    if (p.robot == robot || p.map == map || p.other == map) return Error{"a switch or fusion is under way"};
  }
  const auto way = current.IsValid() ? atlas_->graph().FindWay(map, current) : std::nullopt;
  // Of maps that nobody knows where they lie to each other the tracker looks for its place, as if it were lost.
  DetectedOverlap known;
  known.map = way ? current : MapId();
  known.other = map;
  known.other_from_map = way.value_or(Sim3d());
  Switch(robot, known, now_s);
  proposals_.back().order = order;
  return Ok{};
}

Status MapJoiner::OrderFusion(const Request& order, const DetectedOverlap& overlap, double now_s) {
  if (IsBusy(overlap.map) || IsBusy(overlap.other)) return Error{"a switch or fusion is under way"};
  ++counters_.overlaps;
  atlas_->LinkMaps({overlap.other, overlap.map, overlap.other_from_map, MapGraph::Origin::kOverlap});
  BeginFusion(overlap.map.robot(), overlap.other, overlap.map, overlap, now_s);
  proposals_.back().order = order;
  return Ok{};
}

void MapJoiner::OnMove(const Atlas::Move& move, double now_s) {
  const auto proposal = std::find_if(proposals_.begin(), proposals_.end(), [&](const Proposal& p) {
    return p.stage == Stage::kSwitching && p.robot == move.tracker.robot();
  });
  if (move.entered && move.other.IsValid()) Block(move.map, move.other);  // not back at once
  if (proposal == proposals_.end()) return;
  if (move.entered) {
    Finish(proposal, move.map == proposal->map ? "" : "the tracker went to map " + ToString(move.map), now_s);
  } else if (move.map == proposal->map) {
    Finish(proposal, move.reason.empty() ? "the tracker refused" : move.reason, now_s);
  }
}

void MapJoiner::OnMapperState(const MapperState& state, double now_s) {
  if (state.correction_process != self_) return;
  const auto proposal = std::find_if(proposals_.begin(), proposals_.end(), [&](const Proposal& p) {
    return p.stage == Stage::kProposed && p.number == state.correction_number;
  });
  if (proposal == proposals_.end()) return;
  if (!state.correction_refusal.empty()) {
    // Mostly because the map was corrected since: then it is proposed anew from what it is now.
    if (++proposal->refusals >= options_.max_proposals)
      return Finish(proposal, "refused by the mapper: " + state.correction_refusal, now_s);
    spdlog::info("fusion of map {} and map {} refused by the mapper, proposed anew: {}", ToString(proposal->map),
                 ToString(proposal->other), state.correction_refusal);
    proposal->stage = Stage::kGathering;
    proposal->since_s = now_s;
    return;
  }
  const MapId map = proposal->map, other = proposal->other;
  atlas_->Fuse(map, other, proposal->map_from_other);
  done_.push_back({map, other, state.map == map ? state.revision : 0});
  Finish(proposal, "", now_s);
}

double MapJoiner::PatienceOf(Stage stage) const {
  switch (stage) {
    case Stage::kSwitching:
      return options_.switch_patience_s;
    case Stage::kGathering:
      return options_.grant_patience_s;
    case Stage::kProposing:
      return std::numeric_limits<double>::infinity();  // work of this process
    case Stage::kProposed:
      return options_.answer_patience_s;
  }
  return 0;
}

void MapJoiner::OnTick(double now_s) {
  for (size_t i = proposals_.size(); i-- > 0;) {
    const auto proposal = proposals_.begin() + static_cast<ptrdiff_t>(i);
    const auto trackers = atlas_->TrackersOf(proposal->robot, now_s);
    const bool is_there =
        std::any_of(trackers.begin(), trackers.end(), [&](ProcessId id) { return atlas_->MapOf(id) == proposal->map; });
    if (proposal->stage == Stage::kSwitching && trackers.empty()) {
      Finish(proposal, "the tracker is gone", now_s);
    } else if (proposal->stage == Stage::kSwitching && is_there) {
      Finish(proposal, "", now_s);
    } else if (now_s - proposal->since_s > PatienceOf(proposal->stage)) {
      Finish(proposal,
             proposal->stage == Stage::kGathering
                 ? "no mapper came to own both maps and take the same out of their keyframes"
                 : "no answer",
             now_s);
    } else if (proposal->stage == Stage::kGathering && !atlas_->IsAlive(proposal->owner, now_s)) {
      Gather(&*proposal, now_s);
    }
  }
}

std::optional<FusionTask> MapJoiner::NextFusion(const std::function<Epoch(MapId)>& epoch_of,
                                                const std::function<bool(MapId, MapId)>& agree, double now_s) {
  const auto is_under_way = [](const Proposal& p) { return p.stage == Stage::kProposing; };
  if (std::any_of(proposals_.begin(), proposals_.end(), is_under_way)) return std::nullopt;
  for (Proposal& proposal : proposals_) {
    if (proposal.stage != Stage::kGathering || !proposal.owner.IsValid()) continue;
    const auto is_ready = [&](MapId id) {
      const auto map = atlas_->maps().find(id);
      return map != atlas_->maps().end() && map->second.owner == proposal.owner && epoch_of(id) == map->second.epoch;
    };
    if (!is_ready(proposal.map) || !is_ready(proposal.other) || !agree(proposal.map, proposal.other)) continue;
    proposal.stage = Stage::kProposing;
    proposal.since_s = now_s;
    return FusionTask{proposal.map, proposal.other, proposal.detected};
  }
  return std::nullopt;
}

void MapJoiner::OnProposed(Result<MapCorrection> correction, double now_s) {
  const auto proposal = std::find_if(proposals_.begin(), proposals_.end(),
                                     [](const Proposal& p) { return p.stage == Stage::kProposing; });
  if (proposal == proposals_.end()) return;
  if (!correction) return Finish(proposal, correction.error().message, now_s);
  outbox_ = std::move(*correction);
  outbox_->process = self_;
  outbox_->number = proposal->number = next_number_++;
  proposal->map_from_other = proposal->record.map_from_other = outbox_->map_from_other;
  proposal->stage = Stage::kProposed;
  proposal->since_s = now_s;
}

std::optional<MapCorrection> MapJoiner::TakeCorrection() {
  return std::exchange(outbox_, std::nullopt);
}

void MapJoiner::Finish(Proposals::iterator proposal, const std::string& problem, double now_s) {
  JoinRecord record = std::move(proposal->record);
  const MapId map = proposal->map, other = proposal->other;
  const std::optional<Request> order = std::move(proposal->order);
  proposals_.erase(proposal);
  atlas_->Release(map);
  atlas_->Release(other);
  record.done_s = now_s;
  record.is_done = problem.empty();
  record.problem = problem;
  const bool is_switch = record.kind == JoinRecord::Kind::kSwitch;
  const char* what = is_switch ? "switch" : "fusion";
  if (record.is_done) {
    ++(is_switch ? counters_.switches : counters_.fusions);
    spdlog::info("{} of map {} and map {}: done in {:.2f} s", what, ToString(map), ToString(other),
                 now_s - record.decided_s);
  } else {
    ++counters_.refused;
    spdlog::warn("{} of map {} and map {} came to nothing: {}", what, ToString(map), ToString(other), problem);
    if (other.IsValid()) Block(map, other);
  }
  if (order) ended_orders_.push_back({*order, record});
  records_.push_back(std::move(record));
  if (records_.size() > kMaxRecords) records_.pop_front();
}

}  // namespace portolan
