// New maps: choosing the two frames (paper Sec. 4.1, first step; Sec. 3.4), and taking up tracking when the mapper has made the map.

#include <spdlog/spdlog.h>

#include <algorithm>
#include <utility>

#include "tracking/tracker.h"

namespace portolan {
namespace {

constexpr int kOffersWhileLost = 6;     // there is no tracking to be paid for
constexpr size_t kMinCommon = 60;       // landmarks that a past frame must share with the last tracked one, to be where a new map begins

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
  beginning_.Start(map, active_map_);
  QueuePastFrames();
}

/// "The initialization of a new map begins with several past image frames that were explored in the last map" (paper Sec. 3.4). None of those that were
/// tracked completes a pair, but the newest: the new map has to show what the camera sees now.
void Tracker::QueuePastFrames() {
  const PinholeCamera& camera = camera_.pinhole;
  const double focal_share = std::min(1.0, std::max(camera.fx, camera.fy) / options_.initializer.reference_focal_px);
  const std::vector<Frame> past = ring_.Overlapping(options_.initializer.min_baseline_px * focal_share, kMinCommon);
  const Frame* last = nullptr;
  for (const Frame& frame : past) {
    const bool is_newest = &frame == &past.back() && ring_.failed().empty();
    beginning_.Queue(frame, last != nullptr ? Turn(*last, frame) : Eigen::Quaterniond::Identity(), is_newest);
    last = &frame;
  }
  for (const Frame& frame : ring_.failed()) {
    beginning_.Queue(frame, last != nullptr ? Turn(*last, frame) : Eigen::Quaterniond::Identity(), true);
    last = &frame;
  }
}

void Tracker::Initialize(Frame frame, Output* output) {
  if (RelocalizeAnywhere(&frame)) {
    OnTracked(&frame, output);
    return;
  }
  frame.map = MapId();
  AskForPlace(&frame, output);
  if (beginning_.map().IsValid()) {
    const Stopwatch stopwatch;
    beginning_.Queue(frame, EstimateRotation(frame, Eigen::Quaterniond::Identity()), true);
    ContinueBeginning(kOffersWhileLost, frame.stamp, output);
    stage_times_.Add("initialize", stopwatch.Milliseconds());
  }
  last_frame_ = std::move(frame);
}

/// @param offers frames to be offered at most.
void Tracker::ContinueBeginning(int offers, Timestamp now, Output* output) {
  auto pair = beginning_.OfferQueued(offers);
  const bool may_send = active_map_.IsValid() || (queries_.MayBegin(now) && !move_);
  if (pair && may_send) SendPair(std::move(*pair), output);
}

/// A frame that shows something, of a tracker that knows no map where it is, goes to the atlas_server, which may know one.
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
  KeyFrameMessage first;
  first.map = beginning_.map();
  KeyFrameMessage second;
  second.map = beginning_.map();
  second.reference = Send(KeyFrameKind::kInitialFirst, &pair.first, std::move(first), output);
  second.camera_from_map = Rigid3d(pair.second_from_first, Eigen::Vector3d::Zero());
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
  return MakeOverlap({map, keyframe->camera_from_map, landmarks}, {old_map, in_old.value_or(frame.camera_from_map), frame.landmarks});
}

/// Where a new map lies to the one before, from those of its first two frames that were tracked there.
std::optional<Sim3d> Tracker::LinkNewMap(MapId id, MapId old_id, const MapBeginning::Frames& frames) {
  const Map* old_map = maps_.Find(old_id);
  if (old_map == nullptr) return std::nullopt;
  links_.NoteActivity(id, old_id);
  std::vector<Overlap> overlaps;
  const Frame* last = nullptr;
  for (const Frame* frame : {&frames.first, &frames.second}) {
    auto overlap = OverlapWith(*frame, maps_.map(id), *old_map);
    if (!overlap) continue;
    overlaps.push_back(std::move(*overlap));
    last = frame;
  }
  const std::optional<Sim3d> link = MeasureLink(overlaps);
  std::string common;
  for (const Overlap& overlap : overlaps) common += " " + std::to_string(overlap.depths.size());
  spdlog::info("new map {} of frames {} and {}: {} points, in common with map {}:{}; {}", ToString(id), frames.first.number, frames.second.number,
               maps_.map(id).points().size(), ToString(old_id), common.empty() ? " nothing" : common,
               link ? "scale " + std::to_string(link->scale) : "no link");
  if (!link) return std::nullopt;
  links_.Link({id, last->data->id}, {old_id, last->reference}, *link);
  AskAtlas("link_maps", id, old_id, link, "");
  return link;
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
}

void Tracker::GoOnFrom(Frame frame) {
  velocity_model_.Update(frame.stamp, frame.camera_from_map);
  reference_keyframe_ = frame.reference;
  reference_ = ReferenceLandmarks(ActiveMap(), *frame.data, frame.landmarks);
  last_frame_ = std::move(frame);
}

void Tracker::BackfillOne() {
  if (backfill_.IsDone()) return;
  const Stopwatch stopwatch;
  const Map* map = maps_.Find(backfill_map_);
  if (map == nullptr) return backfill_.Stop();
  const std::optional<Frame> frame = backfill_.Next(*map);
  if (frame && !history_.Has(frame->number)) history_.Add(*map, *frame, false);
  stage_times_.Add("backfill", stopwatch.Milliseconds());
}

void Tracker::FinishBackfill() {
  while (!backfill_.IsDone()) BackfillOne();
}

}  // namespace portolan
