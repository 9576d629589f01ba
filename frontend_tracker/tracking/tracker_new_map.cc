// New maps: choosing the two frames (paper Sec. 4.1, first step; Sec. 3.4), and taking up tracking when the mapper has made the map.

#include <utility>

#include "tracking/tracker.h"

namespace portolan {

void Tracker::StartNewMap(Output* output) {
  const MapId map = map_ids_.Next();
  replicas_.emplace(map, MapReplica(map));
  output->new_maps.push_back(map);
  beginning_.Start(map);
}

void Tracker::Initialize(Frame frame, Output* output) {
  if (active_map_.IsValid() && TryOldMap(&frame)) {
    OnTracked(&frame, output);
    return;
  }
  const Stopwatch stopwatch;
  auto pair = beginning_.Offer(frame, EstimateRotation(frame, Eigen::Quaterniond::Identity()));
  if (pair) SendPair(std::move(*pair), output);
  last_frame_ = std::move(frame);
  stage_times_.Add("initialize", stopwatch.Milliseconds());
}

bool Tracker::TryOldMap(Frame* frame) {
  const Stopwatch stopwatch;
  AddWords(frame);
  const bool found = relocalizer_.Relocalize(ActiveReplica().map(), index_, &map_tracker_, frame);
  stage_times_.Add("relocalize", stopwatch.Milliseconds());
  if (!found) return false;
  velocity_model_.Reset();
  DropPair();
  beginning_.Stop();
  return true;
}

void Tracker::DropPair() {
  if (!beginning_.sent()) return;
  const KeyFrameId second = beginning_.sent()->second.data->id;
  unacknowledged_.erase(beginning_.sent()->first.data->id);
  unacknowledged_.erase(second);
  if (awaited_keyframe_ == second) awaited_keyframe_.reset();
  beginning_.DropSent();
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

void Tracker::BeginTracking() {
  active_map_ = beginning_.map();
  MapBeginning::Frames frames = beginning_.Take();
  const Map& map = ActiveReplica().map();
  index_ = KeyFrameIndex();
  for (const auto& [id, keyframe] : map.keyframes()) index_.Add(id, WordsOf(keyframe.data));
  keyframe_policy_.StartMap(map);
  map_tracker_.Reset();
  velocity_model_.Reset();
  lost_frames_ = 0;
  state_ = TrackingState::kTracking;

  for (Frame* frame : {&frames.first, &frames.second}) {
    const KeyFrame& keyframe = map.keyframe(frame->data->id);
    frame->camera_from_map = keyframe.camera_from_map;
    frame->landmarks = keyframe.landmarks.ByFeature();
    frame->reference = frame->data->id;
    history_.Add(map, *frame, frame == &frames.second);
  }
  backfill_.Start(std::move(frames.first), std::move(frames.between));

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
  reference_ = ReferenceLandmarks(ActiveReplica().map(), *frame.data, frame.landmarks);
  last_frame_ = std::move(frame);
}

void Tracker::BackfillOne() {
  if (backfill_.IsDone()) return;
  const Stopwatch stopwatch;
  const Map& map = ActiveReplica().map();
  if (const std::optional<Frame> frame = backfill_.Next(map)) history_.Add(map, *frame, false);
  stage_times_.Add("backfill", stopwatch.Milliseconds());
}

void Tracker::FinishBackfill() {
  while (!backfill_.IsDone()) BackfillOne();
}

}  // namespace portolan
