#include "loop/loop_closer.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <utility>

namespace portolan {
namespace {

constexpr size_t kMaxRefusals = 500;  // kept for the report
constexpr int kMaxForwardPatience = 8;
constexpr const char* kPassedOn = "the map has another owner, or is no more";

const char* Name(LoopCloser::JobKind kind) {
  switch (kind) {
    case LoopCloser::JobKind::kLoop:
      return "loop correction";
    case LoopCloser::JobKind::kGlobalBundleAdjustment:
      return "global BA";
    case LoopCloser::JobKind::kForwardBundleAdjustment:
      return "FBA";
  }
  return "";
}

}  // namespace

LoopCloser::LoopCloser(const LoopOptions& options, std::shared_ptr<const Vocabulary> vocabulary, ProcessId process)
    : options_(options),
      process_(process),
      follower_(std::move(vocabulary), process.robot()),
      detector_(options.detector) {}

void LoopCloser::SetActive(bool is_active) {
  is_active_ = is_active;
  if (!is_active && !ready_.empty()) NoteLookedAt(ready_.back().map, ready_.back().keyframe);
  ready_.clear();
  wants_global_.reset();
  detector_.Reset();
}

void LoopCloser::OnMapperState(const MapperState& state) {
  follower_.OnMapperState(state);
  const bool is_mine = state.process.robot() == process_.robot();
  NoteOwner(state.map, state.epoch, is_mine);
  if (state.correction_process == process_) OnAnswered(state);
  if (!state.last_keyframe.IsValid()) return;
  if (!is_mine) {  // a keyframe of this robot's tracker in another's map is looked at there
    if (state.last_keyframe.robot() == process_.robot()) NoteLookedAt(state.map, state.last_keyframe);
    return;
  }
  if (!options_.enabled || !is_active_) return NoteLookedAt(state.map, state.last_keyframe);
  if (state.last_keyframe == last_keyframe_ || (!ready_.empty() && ready_.back().keyframe == state.last_keyframe))
    return;
  ready_.push_back({state.map, state.last_keyframe, state.revision});
  while (static_cast<int>(ready_.size()) > options_.max_waiting) {
    ready_.pop_front();
    ++counters_.passed_over;
  }
}

void LoopCloser::NoteOwner(MapId map, Epoch epoch, bool is_mine) {
  if (!map.IsValid()) return;
  Owner& owner = owners_[map];
  if (epoch >= owner.epoch) owner = {epoch, is_mine};
}

bool LoopCloser::IsMine(MapId map) const {
  const auto owner = owners_.find(map);
  return owner != owners_.end() && owner->second.is_mine;
}

void LoopCloser::OnCommand(const Command& command) {
  switch (command.kind) {
    case CommandKind::kGrantOwnership:  // the atlas_server's own maps are dormant
      return NoteOwner(command.map, command.epoch,
                       command.owner.robot() == process_.robot() && command.owner != command.sender);
    case CommandKind::kFuseMaps:
      return OnFused(command.map, command.other);
    case CommandKind::kAdjustMap:
      if (is_active_ && IsAtHand(command.map)) wants_global_ = command.map;
      return;
    case CommandKind::kForgetMap:
      follower_.Remove(command.map);
      return DropWork(command.map, "the map was deleted");
    default:
      return;  // of others
  }
}

void LoopCloser::OnFused(MapId map, MapId other) {
  const bool is_followed = follower_.IsFollowed(other);
  follower_.Fuse(map, other);
  auto& edges = loop_edges_[map];
  edges.insert(edges.end(), loop_edges_[other].begin(), loop_edges_[other].end());
  for (Ready& ready : ready_) {
    if (ready.map == other) ready = {map, ready.keyframe, 1};  // revisions of two maps say nothing of each other
  }
  DropWork(other, "the map is part of " + ToString(map) + " now");
  if (is_active_ && is_followed && IsMine(map) && options_.enabled && options_.global_ba) wants_global_ = map;
}

/// Of a map that is no more. A job under way is cancelled by who runs it (ShouldCancel).
void LoopCloser::DropWork(MapId map, const std::string& reason) {
  ready_.erase(std::remove_if(ready_.begin(), ready_.end(), [&](const Ready& ready) { return ready.map == map; }),
               ready_.end());
  loop_edges_.erase(map);
  owners_.erase(map);
  if (wants_global_ == map) wants_global_.reset();
  if (corrected_map_ == map) corrected_map_ = MapId();
  if (detector_map_ == map) {
    detector_map_ = MapId();
    detector_.Reset();
  }
  if (proposal_ && proposal_->map == map) ForgetCorrection(reason);
  if (outbox_ && outbox_->map == map) outbox_.reset();
  if (closing_ && closing_map_ == map && !running_) FinishClosure(reason);
}

/// Whether it is here, and its owner will listen.
bool LoopCloser::IsAtHand(MapId map) const {
  return IsMine(map) && Has(map, 1);
}

/// Whether its delta is here, or will never come.
bool LoopCloser::IsReady(const Ready& ready) const {
  return ready.revision == 0 || !IsMine(ready.map) || !follower_.IsFollowed(ready.map) ||
         Has(ready.map, ready.revision);
}

bool LoopCloser::Update() {
  follower_.ApplyPending();
  // One loop at a time: what keyframes see while it is being closed is measured in the map as it was.
  if (ready_.empty() || closing_ || !IsSettled() || !IsReady(ready_.front())) return false;
  const Ready next = ready_.front();
  ready_.pop_front();
  LookAt(next);
  return !ready_.empty();
}

bool LoopCloser::Has(MapId map, Revision revision) const {
  const auto maps = follower_.Maps();
  return std::find(maps.begin(), maps.end(), map) != maps.end() && follower_.map(map).revision() >= revision;
}

/// Whether the replica has the last correction, or the map is another's by now.
bool LoopCloser::IsSettled() const {
  return !corrected_map_.IsValid() || !IsMine(corrected_map_) || !follower_.IsFollowed(corrected_map_) ||
         Has(corrected_map_, corrected_revision_);
}

void LoopCloser::NoteLookedAt(MapId map, KeyFrameId keyframe) {
  last_map_ = map;
  last_keyframe_ = keyframe;
}

void LoopCloser::LookAt(const Ready& ready) {
  NoteLookedAt(ready.map, ready.keyframe);
  if (ready.revision == 0 || !IsAtHand(ready.map)) return;  // of a map that has not begun, or passed on
  const Map& map = follower_.map(ready.map);
  if (map.FindKeyFrame(ready.keyframe) == nullptr) return;  // refused, or pruned since
  if (ready.map != detector_map_) detector_.Reset();
  detector_map_ = ready.map;
  ++counters_.looked_at;
  ++keyframes_since_forward_;
  const LoopDetection detection = detector_.Detect(map, ready.keyframe, follower_.index(), &times_);
  counters_.candidates += static_cast<uint64_t>(detection.candidates);
  counters_.consistent += static_cast<uint64_t>(detection.consistent);
  counters_.confirmed += detection.confirmed ? 1 : 0;
  NoteRefusals(map, detection.refusals);
  if (detection.confirmed) {
    spdlog::info("loop: {} sees the place of {} ({} landmarks){}", ToString(ready.keyframe),
                 ToString(detection.confirmed->matched), detection.confirmed->place.group_inliers,
                 detection.loop ? "" : "; waits for another keyframe to say the same");
  }
  if (detection.loop) OnLoop(map, *detection.loop);
}

void LoopCloser::NoteRefusals(const Map& map, const std::vector<LoopRefusal>& refusals) {
  for (const LoopRefusal& refusal : refusals) {
    spdlog::debug("loop: {} (frame {}) is not {} (frame {}): {}", ToString(refusal.current),
                  map.keyframe(refusal.current).data->frame, ToString(refusal.candidate),
                  map.keyframe(refusal.candidate).data->frame, refusal.reason);
    refusals_.push_back(refusal);
    if (refusals_.size() > kMaxRefusals) refusals_.pop_front();
    ++counters_.refused;
  }
}

void LoopCloser::OnLoop(const Map& map, const DetectedLoop& loop) {
  closing_ = loop;
  closing_map_ = map.id();
  since_detection_.Restart();
  ClosureRecord record;
  record.current = loop.current;
  record.matched = loop.matched;
  record.stamp = map.keyframe(loop.current).data->stamp;
  record.matched_stamp = map.keyframe(loop.matched).data->stamp;
  record.corrected_from_map = loop.corrected_from_map;
  record.inliers = loop.place.inliers;
  record.group_inliers = loop.place.group_inliers;
  spdlog::info("loop: frame {} closes with frame {}: scale {:.3f}, {} inliers, {} landmarks seen again",
               map.keyframe(loop.current).data->frame, map.keyframe(loop.matched).data->frame,
               loop.corrected_from_map.scale, loop.place.inliers, loop.place.group_inliers);
  closures_.push_back(std::move(record));
}

bool LoopCloser::IsForwardDue() const {
  return options_.enabled && is_active_ && options_.forward_ba && ready_.empty() && IsMine(detector_map_) &&
         follower_.IsUpToDate(detector_map_) &&
         keyframes_since_forward_ >= forward_patience_ * options_.forward_every_keyframes;
}

std::optional<LoopCloser::Job> LoopCloser::NextJob() {
  if (running_ || proposal_ || outbox_ || !IsSettled()) return std::nullopt;
  if (closing_ && !IsAtHand(closing_map_)) FinishClosure(kPassedOn);
  if (closing_) return MakeJob(JobKind::kLoop, closing_map_);
  if (wants_global_ && !IsMine(*wants_global_)) wants_global_.reset();
  if (wants_global_ && follower_.IsUpToDate(*wants_global_)) {
    return MakeJob(JobKind::kGlobalBundleAdjustment, *std::exchange(wants_global_, std::nullopt));
  }
  if (!IsForwardDue()) return std::nullopt;
  keyframes_since_forward_ = 0;
  return MakeJob(JobKind::kForwardBundleAdjustment, detector_map_);
}

LoopCloser::Job LoopCloser::MakeJob(JobKind kind, MapId map) {
  auto snapshot = std::make_shared<const Map>(follower_.map(map));
  running_ = Running{kind, map, snapshot->epoch()};
  JobResult result;
  result.kind = kind;
  result.map = map;
  switch (kind) {
    case JobKind::kLoop: {
      LoopClosure loop;
      loop.current = closing_->current;
      loop.matched = closing_->matched;
      loop.current_from_matched = closing_->place.query_from_candidate;
      loop.seen = closing_->place.seen;
      loop.merges = closing_->place.matches;
      loop.earlier_edges = loop_edges_[map];
      return [snapshot, loop, options = options_.correction, result](const std::atomic<bool>& stop) mutable {
        result.correction = CorrectLoop(*snapshot, loop, options, &stop, &result.times);
        return result;
      };
    }
    case JobKind::kGlobalBundleAdjustment:
      return [snapshot, options = options_.global, result](const std::atomic<bool>& stop) mutable {
        result.correction = AdjustGlobally(*snapshot, options, &stop, &result.times);
        return result;
      };
    case JobKind::kForwardBundleAdjustment:
      break;
  }
  return [snapshot, from = last_keyframe_, edges = loop_edges_[map], options = options_.forward,
          result](const std::atomic<bool>& stop) mutable {
    result.correction = AdjustForward(*snapshot, from, edges, options, &stop, &result.times);
    return result;
  };
}

bool LoopCloser::ShouldCancel() const {
  if (!running_) return false;
  if (running_->kind != JobKind::kLoop && (closing_ || !is_active_)) return true;
  if (!IsAtHand(running_->map)) return true;
  return follower_.map(running_->map).epoch() != running_->epoch;
}

void LoopCloser::OnJobCancelled() {
  ++counters_.cancelled;
  const Running cancelled = *std::exchange(running_, std::nullopt);
  spdlog::info("{} of map {} cancelled", Name(cancelled.kind), ToString(cancelled.map));
  if (cancelled.kind == JobKind::kLoop) {
    FinishClosure(kPassedOn);
  } else if (is_active_ && cancelled.kind == JobKind::kGlobalBundleAdjustment && IsMine(cancelled.map)) {
    wants_global_ = cancelled.map;  // after the loop that was in its way
  }
}

void LoopCloser::OnJobDone(JobResult result) {
  running_.reset();
  for (const auto& [stage, samples] : result.times.samples()) {
    for (const double sample : samples) times_.Add(stage, sample);
  }
  if (result.kind == JobKind::kLoop) {
    closures_.back().times = result.times;
    if (result.correction) closing_edges_ = result.correction->loop_edges;
  }
  if (!IsAtHand(result.map)) result.correction = Error{kPassedOn};
  if (!result.correction) {
    spdlog::info("{} of map {} came to nothing: {}", Name(result.kind), ToString(result.map),
                 result.correction.error().message);
    if (result.kind == JobKind::kLoop) FinishClosure(result.correction.error().message);
    if (result.kind == JobKind::kForwardBundleAdjustment)
      forward_patience_ = std::min(2 * forward_patience_, kMaxForwardPatience);
    return;
  }
  outbox_ = std::move(*result.correction);
  outbox_->process = process_;
  outbox_->number = next_number_++;
  outbox_kind_ = result.kind;
}

std::optional<MapCorrection> LoopCloser::TakeCorrection() {
  if (!outbox_) return std::nullopt;
  proposal_ = Proposal{*outbox_kind_, outbox_->number, outbox_->map};
  return std::exchange(outbox_, std::nullopt);
}

void LoopCloser::OnAnswered(const MapperState& state) {
  if (!proposal_ || state.correction_number != proposal_->number) return;
  const JobKind kind = std::exchange(proposal_, std::nullopt)->kind;
  corrected_map_ = state.map;  // the mapper names the corrected map in its answer
  corrected_revision_ = state.revision;
  const std::string& problem = state.correction_refusal;
  if (!problem.empty()) spdlog::warn("the owner refused the {}: {}", Name(kind), problem);
  if (kind == JobKind::kLoop) FinishClosure(problem);
  if (kind == JobKind::kGlobalBundleAdjustment && problem.empty()) ++counters_.global_ba;
  if (kind == JobKind::kForwardBundleAdjustment && problem.empty()) {
    ++counters_.forward_ba;
    forward_patience_ = 1;
  }
}

void LoopCloser::ForgetCorrection(const std::string& reason) {
  if (!proposal_) return;
  const JobKind kind = std::exchange(proposal_, std::nullopt)->kind;
  spdlog::warn("{}: {}", Name(kind), reason);
  if (kind == JobKind::kLoop) FinishClosure(reason);
}

void LoopCloser::FinishClosure(const std::string& problem) {
  ClosureRecord& record = closures_.back();
  record.is_applied = problem.empty();
  record.problem = problem;
  record.times.Add("applied", since_detection_.Milliseconds());
  if (record.is_applied) {
    times_.Add("loop_to_map", since_detection_.Milliseconds());
    ++counters_.closed;
    auto& edges = loop_edges_[closing_map_];
    edges.insert(edges.end(), closing_edges_.begin(), closing_edges_.end());
    if (options_.global_ba && is_active_) wants_global_ = closing_map_;
    keyframes_since_forward_ = 0;
  } else {
    ++counters_.failed;
  }
  closing_.reset();
  detector_.Reset();
}

}  // namespace portolan
