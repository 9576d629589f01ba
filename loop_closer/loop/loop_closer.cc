#include "loop/loop_closer.h"

#include <algorithm>
#include <utility>

namespace portolan {
namespace {

constexpr int kMaxForwardPatience = 8;
constexpr int kMaxGlobalRefusals = 2;  // in a row: the map that the next one is made from is no longer the cause
constexpr size_t kMaxForgotten = 8;    // proposals that may still be answered
constexpr const char* kPassedOn = "the map has another owner, or is no more";
constexpr const char* kCorrected = "the map was corrected meanwhile";
constexpr const char* kRunEnded = "the run ended";

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
  if (!is_mine) {  // what goes into another's map is looked at there; the trackers in it wait for none here
    const bool is_of_mine = state.last_keyframe.robot() == process_.robot();
    if (is_of_mine || follower_.IsFollowed(state.map)) NoteLookedAt(state.map, state.last_keyframe);
    return;
  }
  if (!options_.enabled || !is_active_) return NoteLookedAt(state.map, state.last_keyframe);
  if (state.last_keyframe == last_keyframe_ || (!ready_.empty() && ready_.back().keyframe == state.last_keyframe))
    return;
  ready_.push_back({state.map, state.last_keyframe, state.epoch, state.revision});
  while (static_cast<int>(ready_.size()) > options_.max_waiting) {
    ready_.pop_front();
    journal_.NotePassedOver();
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
    if (ready.map == other) ready = {map, ready.keyframe, 0, 1};  // revisions of two maps say nothing of each other
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
  forgotten_.erase(std::remove_if(forgotten_.begin(), forgotten_.end(),
                                  [&](const Proposal& proposal) { return proposal.map == map; }),
                   forgotten_.end());
  if (outbox_ && outbox_->map == map) outbox_.reset();
  if (closing_ && closing_->map == map && !running_) FinishClosure(reason);
}

/// Whether it is here, and its owner will listen.
bool LoopCloser::IsAtHand(MapId map) const {
  return IsMine(map) && Has(map, 0, 1);
}

/// Whether its delta is here, or will never come.
bool LoopCloser::IsReady(const Ready& ready) const {
  return ready.revision == 0 || !IsMine(ready.map) || !follower_.IsFollowed(ready.map) ||
         Has(ready.map, ready.epoch, ready.revision);
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

/// Whether the replica is so far. A later epoch is, at whatever revision: its owner may have begun with less.
bool LoopCloser::Has(MapId id, Epoch epoch, Revision revision) const {
  const Map* map = follower_.Find(id);
  if (map == nullptr) return false;
  return map->epoch() == epoch ? map->revision() >= revision : map->epoch() > epoch;
}

/// Whether the replica has the last correction, or the map is another's by now.
bool LoopCloser::IsSettled() const {
  return !corrected_map_.IsValid() || !IsMine(corrected_map_) || !follower_.IsFollowed(corrected_map_) ||
         Has(corrected_map_, corrected_epoch_, corrected_revision_);
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
  detector_keyframe_ = ready.keyframe;
  ++keyframes_since_forward_;
  StageTimes times;
  const LoopDetection detection = detector_.Detect(map, ready.keyframe, follower_.index(), &times);
  KeepTimes(times);
  journal_.NoteDetection(map, ready.keyframe, detection);
  if (!detection.loop) return;
  closing_ = Closing{*detection.loop, map.id(), journal_.OpenClosure(map, *detection.loop, times), {}, {}};
}

void LoopCloser::KeepTimes(const StageTimes& times) {
  for (const auto& [stage, samples] : times.samples()) {
    for (const double sample : samples) times_.Add(stage, sample);
  }
}

bool LoopCloser::IsForwardDue() const {
  return options_.enabled && is_active_ && options_.forward_ba && ready_.empty() && IsMine(detector_map_) &&
         follower_.IsUpToDate(detector_map_) &&
         keyframes_since_forward_ >= forward_patience_ * options_.forward_every_keyframes && ForwardStart().IsValid();
}

/// The last keyframe that was looked at in the detector's map; where it was pruned since, the newest of its tracker
/// before it, if there is any.
KeyFrameId LoopCloser::ForwardStart() const {
  const auto& keyframes = follower_.map(detector_map_).keyframes();
  const auto after = keyframes.upper_bound(detector_keyframe_);
  if (after == keyframes.begin()) return KeyFrameId();
  const KeyFrameId start = std::prev(after)->first;
  const bool is_of_its_tracker =
      start.robot() == detector_keyframe_.robot() && start.session() == detector_keyframe_.session();
  return is_of_its_tracker ? start : KeyFrameId();
}

std::optional<LoopCloser::Job> LoopCloser::NextJob() {
  if (running_ || proposal_ || outbox_ || !IsSettled()) return std::nullopt;
  if (closing_ && !IsAtHand(closing_->map)) FinishClosure(kPassedOn);
  if (closing_) return MakeJob(JobKind::kLoop, closing_->map);
  if (wants_global_ && !IsMine(*wants_global_)) wants_global_.reset();
  if (wants_global_ && follower_.IsUpToDate(*wants_global_)) {
    return MakeJob(JobKind::kGlobalBundleAdjustment, *std::exchange(wants_global_, std::nullopt));
  }
  if (!IsForwardDue()) return std::nullopt;
  keyframes_before_forward_ = std::exchange(keyframes_since_forward_, 0);
  return MakeJob(JobKind::kForwardBundleAdjustment, detector_map_);
}

LoopCloser::Job LoopCloser::MakeJob(JobKind kind, MapId map) {
  auto snapshot = std::make_shared<const Map>(follower_.map(map));
  running_ = Running{kind, map, snapshot->epoch(), snapshot->revision()};
  journal_.NoteTried(kind);
  JobResult result;
  result.kind = kind;
  result.map = map;
  switch (kind) {
    case JobKind::kLoop: {
      LoopClosure loop;
      loop.current = closing_->loop.current;
      loop.matched = closing_->loop.matched;
      loop.current_from_matched = closing_->loop.place.query_from_candidate;
      loop.seen = closing_->loop.place.seen;
      loop.merges = closing_->loop.place.matches;
      loop.earlier_edges = loop_edges_[map];
      return [snapshot, loop, options = options_.correction, result](const std::atomic<bool>& stop) mutable {
        result.correction = CorrectLoop(*snapshot, loop, options, &stop, &result.times);
        return result;
      };
    }
    case JobKind::kGlobalBundleAdjustment:
      return [snapshot, options = options_.global, result](const std::atomic<bool>& stop) mutable {
        result.correction = AdjustGlobally(*snapshot, options, &stop, &result.times, &result.losses);
        return result;
      };
    case JobKind::kForwardBundleAdjustment:
      break;
  }
  return [snapshot, from = ForwardStart(), edges = loop_edges_[map], options = options_.forward,
          result](const std::atomic<bool>& stop) mutable {
    result.correction = AdjustForward(*snapshot, from, edges, options, &stop, &result.times, &result.losses);
    return result;
  };
}

bool LoopCloser::ShouldCancel() const {
  if (!running_) return false;
  if (running_->kind != JobKind::kLoop && (closing_ || !is_active_)) return true;
  if (!IsAtHand(running_->map) || IsOutdated(*running_)) return true;
  return follower_.map(running_->map).epoch() != running_->epoch;
}

/// Whether an answer that came late tells of a correction that its snapshot is without.
bool LoopCloser::IsOutdated(const Running& running) const {
  return running.map == corrected_map_ && running.epoch == corrected_epoch_ && running.revision < corrected_revision_;
}

void LoopCloser::OnJobCancelled() {
  const Running cancelled = *std::exchange(running_, std::nullopt);
  journal_.NoteCancelled(cancelled.kind, cancelled.map);
  switch (cancelled.kind) {
    case JobKind::kLoop:
      return FinishClosure(IsOutdated(cancelled) ? kCorrected : kPassedOn);
    case JobKind::kGlobalBundleAdjustment:  // after the loop that was in its way
      if (is_active_ && IsMine(cancelled.map)) wants_global_ = cancelled.map;
      return;
    case JobKind::kForwardBundleAdjustment:
      keyframes_since_forward_ += keyframes_before_forward_;
  }
}

void LoopCloser::OnJobDone(JobResult result) {
  running_.reset();
  KeepTimes(result.times);
  if (result.losses) journal_.NoteLosses(result.kind, *result.losses);
  if (result.kind == JobKind::kLoop) {
    journal_.AddTimes(closing_->record, result.times);
    if (result.correction) closing_->edges = result.correction->loop_edges;
  }
  if (!IsAtHand(result.map)) result.correction = Error{kPassedOn};
  if (!result.correction) {
    const std::string& reason = result.correction.error().message;
    journal_.NoteFruitless(result.kind, result.map, reason);
    if (result.kind == JobKind::kLoop) FinishClosure(reason);
    if (result.kind == JobKind::kGlobalBundleAdjustment) global_refusals_ = 0;
    if (result.kind == JobKind::kForwardBundleAdjustment)
      forward_patience_ = std::min(2 * forward_patience_, kMaxForwardPatience);
    return;
  }
  journal_.NoteProposed(result.kind, result.map);
  outbox_ = std::move(*result.correction);
  outbox_->process = process_;
  outbox_->number = next_number_++;
  outbox_kind_ = result.kind;
}

std::optional<MapCorrection> LoopCloser::TakeCorrection() {
  if (!outbox_) return std::nullopt;
  proposal_ = Proposal{*outbox_kind_, outbox_->number, outbox_->map, outbox_->epoch, {}};
  return std::exchange(outbox_, std::nullopt);
}

void LoopCloser::OnAnswered(const MapperState& state) {
  const auto is_meant = [&](const Proposal& proposal) { return proposal.number == state.correction_number; };
  const auto forgotten = std::find_if(forgotten_.begin(), forgotten_.end(), is_meant);
  if (forgotten != forgotten_.end()) {
    const Proposal late = std::move(*forgotten);
    forgotten_.erase(forgotten);
    return OnLateAnswer(late, state);
  }
  if (!proposal_ || !is_meant(*proposal_)) return;
  const Proposal answered = *std::exchange(proposal_, std::nullopt);
  const std::string& problem = state.correction_refusal;
  journal_.NoteAnswered(answered.kind, answered.map, problem, false);
  if (state.map == answered.map) NoteCorrected(state);  // refused, too: the next is made from what the owner has now
  if (answered.kind == JobKind::kLoop) FinishClosure(problem);
  if (problem.empty()) {
    OnApplied(answered);
  } else if (answered.kind == JobKind::kGlobalBundleAdjustment) {
    TryGlobalAgain(answered.map);
  }
}

/// Of an owner that hung. In a later epoch the map has another one, who may have begun without the correction.
void LoopCloser::OnLateAnswer(const Proposal& late, const MapperState& state) {
  const auto owner = owners_.find(late.map);
  if (owner == owners_.end() || owner->second.epoch != late.epoch) return;
  const std::string& problem = state.correction_refusal;
  journal_.NoteAnswered(late.kind, late.map, problem, true);
  if (!problem.empty()) {
    if (late.forgotten_loop) journal_.NoteFailed(late.forgotten_loop->record, problem);
    if (late.kind == JobKind::kGlobalBundleAdjustment) TryGlobalAgain(late.map);
    return;
  }
  if (state.map == late.map) NoteCorrected(state);
  if (late.forgotten_loop) EndClosure(*late.forgotten_loop, "");
  OnApplied(late);
  // A loop that was found since was measured in the map as it was. One that is proposed already the owner refuses.
  const bool is_under_way = (running_ && running_->kind == JobKind::kLoop) ||
                            (outbox_ && *outbox_kind_ == JobKind::kLoop) ||
                            (proposal_ && proposal_->kind == JobKind::kLoop);
  if (late.forgotten_loop && closing_ && closing_->map == late.map && !is_under_way) FinishClosure(kCorrected);
}

void LoopCloser::NoteCorrected(const MapperState& state) {
  corrected_map_ = state.map;
  corrected_epoch_ = state.epoch;
  corrected_revision_ = state.revision;
}

void LoopCloser::OnApplied(const Proposal& proposal) {
  if (proposal.map == detector_map_) {
    if (proposal.kind == JobKind::kLoop) {
      detector_.Reset();
    } else {
      detector_.ForgetConfirmations();
    }
  }
  if (proposal.kind == JobKind::kGlobalBundleAdjustment) global_refusals_ = 0;
  if (proposal.kind == JobKind::kForwardBundleAdjustment) forward_patience_ = 1;
}

/// A global BA that was refused was made from a map that was corrected since, or is about to pass on.
void LoopCloser::TryGlobalAgain(MapId map) {
  if (is_active_ && ++global_refusals_ < kMaxGlobalRefusals) {
    wants_global_ = map;
  } else {
    global_refusals_ = 0;
  }
}

void LoopCloser::ForgetCorrection(const std::string& reason) {
  if (!proposal_) return;
  Proposal forgotten = *std::exchange(proposal_, std::nullopt);
  journal_.NoteUnanswered(forgotten.kind, reason);
  if (forgotten.kind == JobKind::kLoop) {
    forgotten.forgotten_loop = closing_;
    FinishClosure(reason);
  }
  forgotten_.push_back(std::move(forgotten));
  if (forgotten_.size() > kMaxForgotten) forgotten_.pop_front();
}

void LoopCloser::End() {
  if (running_) journal_.NoteCancelled(running_->kind, running_->map);
  running_.reset();
  if (closing_) FinishClosure(kRunEnded);
}

void LoopCloser::FinishClosure(const std::string& problem) {
  EndClosure(*std::exchange(closing_, std::nullopt), problem);
  detector_.Reset();
}

void LoopCloser::EndClosure(const Closing& closing, const std::string& problem) {
  if (!problem.empty()) return journal_.NoteFailed(closing.record, problem);
  journal_.NoteApplied(closing.record, closing.since_detection.Milliseconds());
  times_.Add("loop_to_map", closing.since_detection.Milliseconds());
  auto& edges = loop_edges_[closing.map];
  edges.insert(edges.end(), closing.edges.begin(), closing.edges.end());
  if (options_.global_ba && is_active_) wants_global_ = closing.map;
  keyframes_since_forward_ = 0;
}

}  // namespace portolan
