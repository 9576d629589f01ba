// New maps: choosing the two frames (paper Sec. 4.1, first step; Sec. 3.4), and taking up tracking when the mapper has made the map.

#include <algorithm>
#include <utility>

#include "tracking/tracker.h"

namespace portolan {
namespace {

constexpr size_t kMaxWaitingFrames = 30;    // while the mapper makes the map; at 30 Hz a second, many times what it takes
constexpr size_t kMaxBetweenFrames = 120;   // kept for backfill; more than the initializer waits for one pair

}  // namespace

void Tracker::StartNewMap(Output* output) {
  new_map_ = map_ids_.Next();
  replicas_.emplace(new_map_, MapReplica(new_map_));
  output->new_maps.push_back(new_map_);
  initializer_.Reset();
  pending_pair_.reset();
  waiting_frames_.clear();
  between_frames_.clear();
}

void Tracker::Initialize(Frame frame, Output* output) {
  if (active_map_.IsValid() && TryOldMap(&frame)) {
    OnTracked(&frame, output);
    return;
  }
  const Stopwatch stopwatch;
  const Eigen::Quaterniond turn = EstimateRotation(frame, Eigen::Quaterniond::Identity());
  if (pending_pair_) {
    if (waiting_frames_.size() < kMaxWaitingFrames) waiting_frames_.push_back(frame);
    initializer_.Offer(frame, turn);  // keeps its rotation and matches going, in case the mapper refuses
  } else {
    auto pair = initializer_.Offer(frame, turn);
    if (initializer_.num_matches() == 0) between_frames_.clear();  // a new first frame
    if (between_frames_.size() < kMaxBetweenFrames) between_frames_.push_back(frame);
    if (pair) SendPair(std::move(*pair), output);
  }
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
  new_map_ = MapId();
  DropPair();
  initializer_.Reset();
  return true;
}

bool Tracker::HasPairArrived() const {
  if (!pending_pair_) return false;
  const Map& map = replicas_.at(new_map_).map();
  return map.FindKeyFrame(pending_pair_->first.data->id) != nullptr && map.FindKeyFrame(pending_pair_->second.data->id) != nullptr;
}

void Tracker::DropPair() {
  if (!pending_pair_) return;
  const KeyFrameId first = pending_pair_->first.data->id, second = pending_pair_->second.data->id;
  unacknowledged_.erase(first);
  unacknowledged_.erase(second);
  if (awaited_keyframe_ == second) awaited_keyframe_.reset();
  pending_pair_.reset();
  waiting_frames_.clear();
}

void Tracker::SendPair(Initializer::Pair pair, Output* output) {
  KeyFrameMessage first;
  first.map = new_map_;
  KeyFrameMessage second;
  second.map = new_map_;
  second.reference = Send(KeyFrameKind::kInitialFirst, &pair.first, std::move(first), output);
  second.camera_from_map = Rigid3d(pair.second_from_first, Eigen::Vector3d::Zero());
  second.initial_matches = pair.matches;
  Send(KeyFrameKind::kInitialSecond, &pair.second, std::move(second), output);
  pending_pair_.emplace(std::move(pair.first), std::move(pair.second));
  waiting_frames_.clear();
}

void Tracker::BeginTracking() {
  active_map_ = new_map_;
  new_map_ = MapId();
  const Map& map = ActiveReplica().map();
  index_ = KeyFrameIndex();
  for (const auto& [id, keyframe] : map.keyframes()) index_.Add(id, WordsOf(keyframe.data));
  keyframe_policy_.StartMap(map);
  map_tracker_.Reset();
  velocity_model_.Reset();
  lost_frames_ = 0;

  for (Frame* frame : {&pending_pair_->first, &pending_pair_->second}) {
    const KeyFrame& keyframe = map.keyframe(frame->data->id);
    frame->camera_from_map = keyframe.camera_from_map;
    frame->landmarks = keyframe.landmarks.ByFeature();
    frame->reference = frame->data->id;
    history_.Add(map, *frame, frame == &pending_pair_->second);
  }
  backfill_.clear();
  for (Frame& frame : between_frames_) {
    if (frame.number > pending_pair_->first.number && frame.number < pending_pair_->second.number) backfill_.push_back(std::move(frame));
  }
  backfill_last_ = std::move(pending_pair_->first);
  between_frames_.clear();

  // Up from the second keyframe, through the frames that came while the mapper worked.
  Frame& second = pending_pair_->second;
  velocity_model_.Update(second.stamp, second.camera_from_map);
  reference_keyframe_ = second.reference;
  reference_ = ReferenceLandmarks(map, *second.data, second.landmarks);
  last_frame_ = std::move(second);
  pending_pair_.reset();
  state_ = TrackingState::kTracking;
  for (Frame& frame : waiting_frames_) {
    if (!TrackInMap(&frame)) {
      last_frame_ = std::move(frame);
      continue;
    }
    velocity_model_.Update(frame.stamp, frame.camera_from_map);
    reference_keyframe_ = frame.reference;
    reference_ = ReferenceLandmarks(map, *frame.data, frame.landmarks);
    history_.Add(map, frame, false);
    last_frame_ = std::move(frame);
  }
  waiting_frames_.clear();
}

void Tracker::BackfillOne() {
  if (backfill_.empty()) return;
  const Stopwatch stopwatch;
  const auto replica = replicas_.find(active_map_);
  Frame frame = std::move(backfill_.front());
  backfill_.pop_front();
  const Map& map = replica->second.map();
  MapTracker tracker(options_.map_tracking);
  const auto reference = ReferenceLandmarks(map, *backfill_last_->data, backfill_last_->landmarks);
  Rigid3d predicted = backfill_last_->camera_from_map;
  const auto turn = rotation_estimator_.EstimateRotation(backfill_last_->small, frame.small, Eigen::Quaterniond::Identity());
  if (turn.ok) {
    const Eigen::Vector3d centre = predicted.TargetOriginInSource();
    predicted.rotation = (turn.current_from_reference * predicted.rotation).normalized();
    predicted.translation = -(predicted.rotation * centre);
  }
  if (tracker.TrackCoarse(map, reference, predicted, options_.map_tracking.wide_radius_px, &frame) >= options_.keyframe.min_points &&
      tracker.TrackFine(map, &frame) >= options_.min_tracked_points) {
    history_.Add(map, frame, false);
    backfill_last_ = std::move(frame);
  }
  stage_times_.Add("backfill", stopwatch.Milliseconds());
}

void Tracker::FinishBackfill() {
  while (!backfill_.empty()) BackfillOne();
}

}  // namespace portolan
