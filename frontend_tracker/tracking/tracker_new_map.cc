// New maps: choosing the two frames (paper Sec. 4.1, first step; Sec. 3.4), and taking up tracking when the mapper has
// made the map.

#include <spdlog/spdlog.h>

#include <algorithm>
#include <utility>

#include "tracking/tracker.h"

namespace portolan {
namespace {

constexpr int kBackfillPatience = 60;   // frames, two to four seconds
constexpr int kOffersPerFrame = 6;      // each takes some milliseconds; there is no tracking to be paid for
constexpr double kLeastBaseline = 0.5;  // of the initializer's, where the motion is known; after each refusal
constexpr double kBaselineSteps = 0.5;  // so much more,
constexpr int kNumBaselines = 4;        // so often, and again from there
constexpr size_t kGrownKeyFrames = 10;  // of a new map, after which its link is measured once more
// Landmarks that a past frame must share with the last tracked one, to be where a new map begins.
constexpr size_t kMinCommon = 60;

Eigen::Quaterniond Turn(const Frame& from, const Frame& to) {
  return (to.camera_from_map.rotation * from.camera_from_map.rotation.conjugate()).normalized();
}

}  // namespace

std::vector<Request> Tracker::RequestFirstMap() {
  if (!active_map_.IsValid() && !beginning_.map().IsValid() && !options_.localization_only) StartNewMap();
  return std::exchange(requests_, {});
}

void Tracker::StartNewMap() {
  const MapId map = spare_map_.IsValid() ? spare_map_ : map_ids_.Next();
  spare_map_ = MapId();
  maps_.Follow(map, false);
  AskAtlas("new_map", map, active_map_, std::nullopt, "");
  refused_pairs_ = 0;
  beginning_.Start(map, active_map_);
  if (!HasPose()) QueuePastFrames();
}

/// The youngest tracked frames over which the camera has moved enough. @param baseline_factor of what the initializer
/// asks for.
std::vector<Frame> Tracker::PastFrames(double baseline_factor) const {
  return ring_.Overlapping(baseline_factor * RequiredBaseline(options_.initializer, camera_.pinhole), kMinCommon);
}

/// "The initialization of a new map begins with several past image frames that were explored in the last map" (paper
/// Sec. 3.4), for a camera that is lost: they are the first of a pair, and what came since is the second, for the new
/// map has to show what the camera sees now.
void Tracker::QueuePastFrames() {
  const Frame* last = nullptr;
  const auto queue = [&](const Frame& frame, bool may_complete) {
    beginning_.Queue(frame, last != nullptr ? Turn(*last, frame) : Eigen::Quaterniond::Identity(), may_complete);
    last = &frame;
  };
  const std::vector<Frame> past = PastFrames(1.0);
  for (const Frame& frame : past) queue(frame, false);
  for (const Frame& frame : ring_.failed()) queue(frame, true);
}

/// The same for a camera that is tracked: this frame with a past one. After each refusal by the mapper with one from
/// farther away, up to a limit.
void Tracker::OfferTrackedPair(const Frame& frame, Output* output) {
  if (!beginning_.map().IsValid() || beginning_.sent()) return;
  const Stopwatch stopwatch;
  const double factor = kLeastBaseline + kBaselineSteps * (refused_pairs_ % kNumBaselines);
  const std::vector<Frame> past = PastFrames(factor);
  auto pair = past.size() < 2 ? std::nullopt : MakeTrackedPair(ActiveMap(), past.front(), frame, options_.initializer);
  if (pair) SendPair(std::move(*pair), output);
  stage_times_.Add("initialize", stopwatch.Milliseconds());
}

void Tracker::Initialize(Frame frame, Output* output) {
  Reckon(&frame, false);
  if (RelocalizeAnywhere(&frame)) {
    OnTracked(&frame, output);
    return;
  }
  frame.map = MapId();
  AskForPlace(&frame, output);
  if (beginning_.map().IsValid()) {
    const Stopwatch stopwatch;
    beginning_.Queue(frame, turn_by_image_.value_or(Eigen::Quaterniond::Identity()), true);
    ContinueBeginning(frame.stamp, output);
    stage_times_.Add("initialize", stopwatch.Milliseconds());
  }
  last_frame_ = std::move(frame);
}

void Tracker::ContinueBeginning(Timestamp now, Output* output) {
  auto pair = beginning_.OfferQueued(kOffersPerFrame);
  const bool may_send = active_map_.IsValid() || (queries_.MayBegin(now) && !move_);
  if (pair && may_send) SendPair(std::move(*pair), output);
}

/// A frame that shows something, of a tracker that knows no map where it is, goes to the atlas_server, which may know
/// one.
void Tracker::AskForPlace(Frame* frame, Output* output) {
  const bool may_be_known = active_map_.IsValid() || options_.localization_only || queries_.maps_in_atlas() > 0;
  if (!may_be_known || move_ || !queries_.IsDue(frame->stamp)) return;
  if (static_cast<int>(frame->data->features.size()) < options_.initializer.min_features) return;
  output->keyframes.push_back(MakeMessage(KeyFrameKind::kQuery, frame, KeyFrameMessage()));
  AskAtlas("locate", MapId(), active_map_, std::nullopt, ToString(frame->data->id));
  queries_.NoteSent(frame->stamp);
}

void Tracker::DropPair() {
  if (!beginning_.sent()) return;
  const KeyFrameId second = beginning_.sent()->second.data->id;
  unacknowledged_.erase(beginning_.sent()->first.data->id);
  unacknowledged_.erase(second);
  if (awaited_keyframe_ == second) awaited_keyframe_.reset();
  beginning_.DropSent();
}

void Tracker::StopBeginning() {
  if (!beginning_.map().IsValid()) return;
  if (!beginning_.any_sent()) spare_map_ = beginning_.map();
  DropPair();
  beginning_.Stop();
}

void Tracker::SendPair(Initializer::Pair pair, Output* output) {
  // Found after the first was seen, maybe.
  for (Frame* frame : {&pair.first, &pair.second}) frame->data = WithResidual(frame->data, camera_.residual);
  KeyFrameMessage first;
  first.map = beginning_.map();
  KeyFrameMessage second;
  second.map = beginning_.map();
  second.reference = Send(KeyFrameKind::kInitialFirst, &pair.first, std::move(first), output);
  second.camera_from_map = Rigid3d(pair.second_from_first, pair.translation);
  second.initial_matches = pair.matches;
  Send(KeyFrameKind::kInitialSecond, &pair.second, std::move(second), output);
  beginning_.NoteSent(std::move(pair.first), std::move(pair.second));
}

/// A frame that was tracked in the old map and is a keyframe of the new one.
std::optional<Overlap> Tracker::OverlapWith(const Frame& frame, const Map& map, const Map& old_map) const {
  const KeyFrame* keyframe = map.FindKeyFrame(frame.data->id);
  if (keyframe == nullptr || frame.map != old_map.id()) return std::nullopt;
  // Where the old map has it now, which may have been corrected since.
  const auto record = history_.records().find(frame.number);
  const bool recorded = record != history_.records().end() && record->second.map == old_map.id();
  const auto in_old = recorded ? FrameHistory::CameraFromMap(old_map, record->second) : std::nullopt;
  const std::vector<MapPointId> landmarks = keyframe->landmarks.ByFeature();
  return MakeOverlap({map, keyframe->camera_from_map, landmarks},
                     {old_map, in_old.value_or(frame.camera_from_map), frame.landmarks});
}

/// Where a new map lies to the one before, from those of its first two frames that were tracked there.
std::optional<Sim3d> Tracker::LinkNewMap(MapId map, MapId old_map, const MapBeginning::Frames& frames) {
  if (maps_.Find(old_map) == nullptr) return std::nullopt;
  links_.NoteActivity(map, old_map);
  const auto link = MeasureNewLink(map, old_map, frames.first, frames.second);
  if (link) young_link_ = YoungLink{map, old_map, frames.first, frames.second};
  return link;
}

std::optional<Sim3d> Tracker::MeasureNewLink(MapId map, MapId old_map, const Frame& first, const Frame& second) {
  std::vector<Overlap> overlaps;
  std::string common;
  const Frame* last = nullptr;
  for (const Frame* frame : {&first, &second}) {
    auto overlap = OverlapWith(*frame, maps_.map(map), maps_.map(old_map));
    if (!overlap) continue;
    common += " " + std::to_string(overlap->depths.size());
    overlaps.push_back(std::move(*overlap));
    last = frame;
  }
  const std::optional<Sim3d> link = MeasureLink(overlaps);
  spdlog::info("map {} of frames {} and {}: {} points; features in common with map {}:{}; {}", ToString(map),
               first.number, second.number, maps_.map(map).points().size(), ToString(old_map),
               common.empty() ? " none" : common, link ? "scale " + std::to_string(link->scale) : "no link");
  if (!link) return std::nullopt;
  links_.Link({map, last->data->id}, {old_map, last->reference}, *link);
  AskAtlas("link_maps", map, old_map, link, "");
  return link;
}

/// By then the depths of what its first frames see come from more than two views, and they see more of it.
void Tracker::RefineLink() {
  if (!young_link_) return;
  const YoungLink& young = *young_link_;
  const bool is_there = maps_.Find(young.map) != nullptr && maps_.Find(young.old_map) != nullptr;
  if (is_there && maps_.map(young.map).keyframes().size() < kGrownKeyFrames) return;
  if (is_there) MeasureNewLink(young.map, young.old_map, young.first, young.second);
  young_link_.reset();
}

/// The map is made while the camera is still tracked in the old one: the next frame goes over.
void Tracker::PlanToEnterNewMap() {
  const MapId map = beginning_.map(), old_map = beginning_.old_map();
  const MapBeginning::Frames frames = beginning_.Take();
  PlannedMove move;
  move.target = map;
  move.is_new_map = true;
  const std::optional<Sim3d> map_from_old = LinkNewMap(map, old_map, frames);
  if (map_from_old && old_map == active_map_) move.target_from_active = map_from_old;
  move_ = move;
}

void Tracker::BeginTracking(uint64_t frame_now) {
  const MapId old_map = beginning_.old_map();
  active_map_ = beginning_.map();
  MapBeginning::Frames frames = beginning_.Take();
  LinkNewMap(active_map_, old_map, frames);
  if (move_) move_->target_from_active.reset();  // it was from the old map
  const Map& map = ActiveMap();
  keyframe_policy_.StartMap(map);
  map_tracker_.Reset();
  velocity_model_.Reset();
  ring_.Clear();
  lost_frames_ = 0;
  if (lost_since_) events_.frames_to_new_map.push_back(static_cast<int>(frame_now - *lost_since_));
  lost_since_.reset();
  state_ = TrackingState::kTracking;

  for (Frame* frame : {&frames.first, &frames.second}) {
    const KeyFrame& keyframe = map.keyframe(frame->data->id);
    frame->camera_from_map = keyframe.camera_from_map;
    frame->landmarks = keyframe.landmarks.ByFeature();
    frame->reference = frame->data->id;
    if (!history_.Has(frame->number)) history_.Add(map, *frame, frame == &frames.second);
  }
  backfill_.Start(std::move(frames.first), std::move(frames.between));
  backfill_map_ = active_map_;
  backfill_waits_ = 0;

  // Up from the second keyframe, through the frames that came while the mapper worked.
  GoOnFrom(std::move(frames.second));
  for (Frame& frame : frames.since) {
    if (!TrackInMap(&frame)) {
      last_frame_ = std::move(frame);
      continue;
    }
    history_.Add(map, frame, false);
    GoOnFrom(std::move(frame));
  }
  turn_by_image_.reset();  // it was between two of these
}

void Tracker::GoOnFrom(Frame frame) {
  velocity_model_.Update(frame.stamp, frame.camera_from_map);
  reference_keyframe_ = frame.reference;
  reference_ = ReferenceLandmarks(ActiveMap(), *frame.data, frame.landmarks);
  last_frame_ = std::move(frame);
}

/// Of frames between the two that a map was made of, those that lie apart become keyframes as later ones do: with two
/// views alone the first of them stays loose against the rest of the map. They wait a while for an idle mapper.
void Tracker::BackfillOne(Output* output) {
  const bool may_insert = !options_.localization_only && backfill_map_ == active_map_ && !IsFull(ActiveMap());
  if (backfill_.IsDone() || (may_insert && !IsMapperIdle() && ++backfill_waits_ <= kBackfillPatience)) return;
  std::optional<Frame> frame = LocalizeBetween();
  if (!frame || !may_insert || !IsMapperIdle() || !keyframe_policy_.FillsGap(ActiveMap(), *frame)) return;
  spdlog::debug("frame {}: {} of {} landmarks, between a map's first two: keyframe", frame->number, frame->num_inliers,
                frame->num_candidates);
  SendTracked(&*frame, output);
}

std::optional<Frame> Tracker::LocalizeBetween() {
  const Stopwatch stopwatch;
  const Map* map = maps_.Find(backfill_map_);
  if (map == nullptr) {
    backfill_.Stop();
    return std::nullopt;
  }
  std::optional<Frame> frame = backfill_.Next(*map);
  if (frame && !history_.Has(frame->number)) history_.Add(*map, *frame, false);
  stage_times_.Add("backfill", stopwatch.Milliseconds());
  return frame;
}

void Tracker::FinishBackfill() {
  while (!backfill_.IsDone()) LocalizeBetween();
}

void Tracker::FinishHistory() {
  FinishBackfill();
  for (const auto& [id, replica] : maps_.replicas()) history_.HangLooseFrames(replica.map());
}

}  // namespace portolan
