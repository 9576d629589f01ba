#include "tracking/tracker.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <utility>

#include "features/feature_quantization.h"

namespace portolan {
namespace {

// From which a new map may begin: a second of a fast camera, three of a slow one.
constexpr size_t kPastFrames = 30;
// Rad, of a frame from its prediction: the rest of a fast turn that ESM did not see.
constexpr double kNearTurn = 0.3;
constexpr double kNearShift = 0.3;  // of what the frame sees, in its depths
// More than come within the seconds that an atlas_server's copy of the map may be old.
constexpr size_t kKeptAcknowledged = 32;

/// Whether the motion model vouches for a pose, roughly.
bool IsNear(const Map& map, const Rigid3d& predicted_camera_from_map, const Frame& frame) {
  const double shift =
      (frame.camera_from_map.TargetOriginInSource() - predicted_camera_from_map.TargetOriginInSource()).norm();
  return frame.camera_from_map.rotation.angularDistance(predicted_camera_from_map.rotation) < kNearTurn &&
         shift < kNearShift * map.MedianDepth(frame.reference);
}

}  // namespace

Tracker::Tracker(const TrackerOptions& options, const CameraModel& camera, std::shared_ptr<const Vocabulary> vocabulary,
                 RobotId robot, uint32_t session)
    : options_(options),
      robot_(robot),
      camera_(camera),
      vocabulary_(std::move(vocabulary)),
      extractor_(options.orb),
      rotation_estimator_(camera.pinhole),
      velocity_model_(options.decaying_velocity),
      map_tracker_(options.map_tracking),
      relocalizer_(options.relocalizer, options.seed),
      keyframe_policy_(options.keyframe),
      beginning_(options.initializer),
      ring_(kPastFrames),
      localizer_(options),
      backfill_(options, camera.pinhole),
      keyframe_ids_(robot, session),
      map_ids_(robot, session),
      links_([this](MapId map) { return maps_.Find(map); }) {}

Tracker::Output Tracker::Track(const Image& image) {
  const Stopwatch whole;
  Output output;
  ApplyPending();
  if (!active_map_.IsValid() && !beginning_.map().IsValid() && !options_.localization_only) StartNewMap();
  Frame frame = MakeFrame(image);
  turn_by_image_.reset();

  if (beginning_.sent() && beginning_.IsMade(maps_.map(beginning_.map()))) {
    if (HasPose()) {
      PlanToEnterNewMap();
    } else {
      BeginTracking(frame.number);
    }
  }
  if (!HasPose()) {
    Initialize(frame, &output);
  } else if (TrackInMap(&frame) || GoOnInLinkedMap(&frame, false)) {
    OnTracked(&frame, &output);
  } else {
    OnFailed(std::move(frame));
  }
  output.requests = std::exchange(requests_, {});
  const bool tracked = state_ == TrackingState::kTracking;
  output.state.frame = frame.number;
  output.state.stamp = frame.stamp;
  output.state.state = state_;
  output.state.map = tracked ? active_map_ : MapId();
  if (tracked) output.state.camera_from_map = last_frame_->camera_from_map;
  output.state.quality = static_cast<float>(last_frame_ && tracked ? last_frame_->Quality() : 0);
  output.state.num_inliers = static_cast<uint32_t>(last_frame_ && tracked ? last_frame_->num_inliers : 0);
  output.state.num_candidates = static_cast<uint32_t>(last_frame_ && tracked ? last_frame_->num_candidates : 0);
  const double milliseconds = whole.Milliseconds();
  output.state.frame_ms = static_cast<float>(milliseconds);
  stage_times_.Add("frame", milliseconds);
  return output;
}

Frame Tracker::MakeFrame(const Image& image) {
  Stopwatch stopwatch;
  KeyFrameData data;
  data.stamp = image.stamp;
  data.frame = image.frame;
  data.camera = camera_.pinhole;
  data.residual = camera_.residual;
  data.pyramid = options_.orb.pyramid;
  data.features = extractor_.Extract(image.grey, camera_);
  // Here already, so that the tracker computes with what the others receive.
  QuantizeFeatures(&data.features, data.camera);
  Frame frame;
  frame.number = image.frame;
  frame.stamp = image.stamp;
  frame.landmarks.resize(data.features.size());
  frame.data = MakeKeyFrameData(std::move(data), nullptr);
  stage_times_.Add("extract", stopwatch.Milliseconds());
  stopwatch.Restart();
  if (options_.use_esm) frame.small = RotationEstimator::Shrink(image.grey);
  stage_times_.Add("shrink", stopwatch.Milliseconds());
  return frame;
}

void Tracker::AddWords(Frame* frame) const {
  if (!frame->data->bow.empty() || vocabulary_ == nullptr) return;
  frame->data = MakeKeyFrameData(*frame->data, vocabulary_.get());
}

Eigen::Quaterniond Tracker::EstimateRotation(const Frame& frame, const Eigen::Quaterniond& predicted) {
  if (!options_.use_esm || !last_frame_ || last_frame_->small.values.empty()) return predicted;
  const Stopwatch stopwatch;
  const auto estimate = rotation_estimator_.EstimateRotation(last_frame_->small, frame.small, predicted);
  stage_times_.Add("esm", stopwatch.Milliseconds());
  turn_by_image_ = estimate.ok ? estimate.current_from_reference : predicted;
  is_view_continuous_ = is_view_continuous_ && estimate.ok;
  return *turn_by_image_;
}

/// Dead reckoning of the orientation, with which a map without a link to those before is hung on to them.
void Tracker::Reckon(Frame* frame, bool is_tracked) {
  if (!last_frame_) return;
  Eigen::Quaterniond turn = Eigen::Quaterniond::Identity();
  if (is_tracked && last_frame_->map == active_map_) {
    turn = frame->camera_from_map.rotation * last_frame_->camera_from_map.rotation.conjugate();
  } else {
    turn = turn_by_image_ ? *turn_by_image_ : EstimateRotation(*frame, Eigen::Quaterniond::Identity());
  }
  frame->camera_from_start = (turn * last_frame_->camera_from_start).normalized();
}

/// Where the camera can be in the active map, as long as its pictures followed one another since it was tracked there;
/// after a cut or in the dark, anywhere.
std::optional<CameraReach> Tracker::Reach(Timestamp now) const {
  if (!options_.use_esm || !is_view_continuous_) return std::nullopt;
  return ReachOfCamera(history_, ActiveMap(), now);
}

std::vector<Rigid3d> Tracker::PredictPoses(const Frame& frame) {
  // Translation from the decaying velocity (paper Eq. 1, 2), rotation from the image (Eq. 3-6).
  const Rigid3d by_velocity = velocity_model_.Predict(frame.stamp);
  if (!options_.use_esm) return {by_velocity};
  const Rigid3d& last = last_frame_->camera_from_map;
  const Eigen::Quaterniond predicted_turn = by_velocity.rotation * last.rotation.conjugate();
  const Eigen::Quaterniond turn =
      EstimateRotation(frame, lost_frames_ == 0 ? predicted_turn : Eigen::Quaterniond::Identity());
  const Eigen::Quaterniond rotation = (turn * last.rotation).normalized();
  const Eigen::Vector3d centre = by_velocity.TargetOriginInSource();
  if (lost_frames_ > 0) return {Rigid3d(rotation, -(rotation * centre))};  // the velocity is of a time before
  // Beyond the paper: close to a wall ESM takes its passing by for a turn, and then the velocity is right about the
  // rotation too.
  return {Rigid3d(rotation, -(rotation * centre)), by_velocity};
}

bool Tracker::TrackByMotion(const Map& map, Frame* frame) {
  const std::vector<Rigid3d> predictions = PredictPoses(*frame);
  Stopwatch stopwatch;
  const int inliers = map_tracker_.TrackCoarse(map, reference_, predictions, frame);
  stage_times_.Add("coarse", stopwatch.Milliseconds());
  if (inliers < options_.map_tracking.min_points) {
    frame->camera_from_map = predictions.front();
    return false;
  }
  stopwatch.Restart();
  map_tracker_.TrackFine(map, frame);
  stage_times_.Add("fine", stopwatch.Milliseconds());
  return IsFound(*frame, options_);
}

bool Tracker::TrackInMap(Frame* frame) {
  const Map& map = ActiveMap();
  if (!reference_.empty() && TrackByMotion(map, frame)) return true;
  // Quality is poor: global relocalisation (paper Fig. 2), the place where the camera was last first.
  const Stopwatch stopwatch;
  const Rigid3d predicted = frame->camera_from_map;
  AddWords(frame);
  const std::optional<CameraReach> reach = Reach(frame->stamp);
  const auto is_right = [&] {
    return IsNear(map, predicted, *frame) ||
           (Relocalizer::IsSure(*frame) && (!reach || reach->Contains(frame->camera_from_map)));
  };
  const bool found =
      (relocalizer_.TrackKeyFrame(map, reference_keyframe_, options_.min_tracked_points, &map_tracker_, frame) &&
       IsFound(*frame, options_) && is_right()) ||
      relocalizer_.Relocalize(map, maps_.index(active_map_), reach, &map_tracker_, frame);
  stage_times_.Add("relocalize", stopwatch.Milliseconds());
  if (found) {
    velocity_model_.Reset();
  } else {
    frame->camera_from_map = predicted;
  }
  return found;
}

void Tracker::OnTracked(Frame* frame, Output* output) {
  Reckon(frame, true);
  state_ = TrackingState::kTracking;
  is_view_continuous_ = true;
  lost_frames_ = 0;
  lost_since_.reset();
  frame->map = active_map_;
  velocity_model_.Update(frame->stamp, frame->camera_from_map);
  ring_.Add(*frame);
  if (ConsiderMapChange(frame)) ring_.Add(*frame);
  const Map& map = ActiveMap();
  reference_keyframe_ = frame->reference;
  reference_ = ReferenceLandmarks(map, *frame->data, frame->landmarks);
  history_.Add(map, *frame, true);
  ConsiderKeyFrame(frame, output);
  OfferTrackedPair(*frame, output);
  RefineLink();
  LookBack(*frame);
  last_frame_ = std::move(*frame);
  BackfillOne(output);
}

void Tracker::OnFailed(Frame frame) {
  Reckon(&frame, false);
  ++lost_frames_;
  spdlog::debug("frame {}: not tracked, {} features, the pictures {}", frame.number, frame.data->features.size(),
                is_view_continuous_ ? "follow one another" : "have jumped");
  state_ = TrackingState::kRelocalizing;
  ring_.AddFailed(frame);
  const uint64_t number = frame.number;
  last_frame_ = std::move(frame);  // its pose is the prediction, from which ESM goes on
  // "If tracking fails for more than five consecutive frames, the tracker is considered to be lost" (paper Sec. 3).
  if (lost_frames_ > options_.max_lost_frames) {
    state_ = TrackingState::kLost;
    lost_since_ = number;
    if (beginning_.map().IsValid() && !beginning_.sent()) QueuePastFrames();
    if (!beginning_.map().IsValid() && !options_.localization_only) StartNewMap();
  }
}

void Tracker::ConsiderKeyFrame(Frame* frame, Output* output) {
  const Map& map = ActiveMap();
  // A full map grows no more, but for what is needed to go on in it until the next one is there.
  if (options_.localization_only || (IsFull(map) && !beginning_.map().IsValid() && !move_)) return;
  const auto decision = keyframe_policy_.Decide(map, *frame, IsMapperIdle());
  if (spdlog::should_log(spdlog::level::debug)) {  // its arguments look at all keyframes
    spdlog::debug("frame {}: {} of {} landmarks, view {}, urgent {}, mapper idle {}: {}", frame->number,
                  frame->num_inliers, frame->num_candidates, keyframe_policy_.IsViewNew(map, *frame) ? "new" : "known",
                  keyframe_policy_.IsUrgent(map, *frame), IsMapperIdle(),
                  decision == KeyFramePolicy::Decision::kInsert ? "keyframe" : "no keyframe");
  }
  output->state.interrupt_mapper = decision == KeyFramePolicy::Decision::kInterrupt;
  const bool is_kept_for_later = decision == KeyFramePolicy::Decision::kInterrupt && is_mapper_silent_;
  if (decision != KeyFramePolicy::Decision::kInsert && !is_kept_for_later) return;
  SendTracked(frame, output);
}

void Tracker::SendTracked(Frame* frame, Output* output) {
  const Stopwatch stopwatch;
  KeyFrameMessage message;
  message.map = active_map_;
  message.reference = frame->reference;
  message.camera_from_map = frame->camera_from_map;
  for (size_t i = 0; i < frame->landmarks.size(); ++i) {
    if (frame->landmarks[i].IsValid()) message.landmarks.emplace_back(static_cast<uint32_t>(i), frame->landmarks[i]);
  }
  const KeyFrameId id = Send(KeyFrameKind::kTracked, frame, std::move(message), output);
  history_.NoteKeyFrame(frame->number, id);
  stage_times_.Add("keyframe", stopwatch.Milliseconds());
}

KeyFrameMessage Tracker::MakeMessage(KeyFrameKind kind, Frame* frame, KeyFrameMessage message) {
  KeyFrameData data = *frame->data;
  data.id = keyframe_ids_.Next();
  data.bow.clear();  // not sent: whoever needs the derived fields makes them
  data.nodes.clear();
  data.grid = FeatureGrid();
  message.kind = kind;
  message.data = data;
  message.vocabulary_hash = vocabulary_ != nullptr ? vocabulary_->hash() : 0;
  frame->data = MakeKeyFrameData(std::move(data), vocabulary_.get());
  return message;
}

KeyFrameId Tracker::Send(KeyFrameKind kind, Frame* frame, KeyFrameMessage message, Output* output) {
  message = MakeMessage(kind, frame, std::move(message));
  const KeyFrameId id = frame->data->id;
  maps_.AddKeyFrameData(message.map, frame->data);
  unacknowledged_[id] = message;
  if (unacknowledged_.size() > kMaxUnacknowledged) {  // some may be of maps that nobody writes any more
    unacknowledged_.erase(unacknowledged_.begin());
    ++num_given_up_;
  }
  awaited_keyframe_ = id;
  keyframe_policy_.NoteKeyFrame(id, frame->stamp);
  ++num_keyframes_sent_;
  output->keyframes.push_back(std::move(message));
  return id;
}

bool Tracker::IsMapperIdle() const {
  return !awaited_keyframe_ && mapper_state_.idle;
}

void Tracker::AddDelta(MapDelta delta) {
  maps_.AddDelta(std::move(delta));
}

void Tracker::AddKeyFrameData(MapId map, std::shared_ptr<const KeyFrameData> data) {
  maps_.AddKeyFrameData(map, std::move(data));
}

/// One mapper may serve several robots and maps: what it says of others tells whether it is idle, and no more.
bool Tracker::Concerns(const MapperState& state) const {
  if (!active_map_.IsValid() && !state.map.IsValid()) return state.process.robot() == robot_;
  for (const MapId map : {active_map_, beginning_.map()}) {
    if (!map.IsValid()) continue;
    const auto owner = owners_.find(map);
    if (map == state.map || (owner != owners_.end() && owner->second.process == state.process)) return true;
  }
  return false;
}

void Tracker::NoteOwner(MapId map, Epoch epoch, ProcessId process) {
  Owner& owner = owners_[map];
  if (epoch >= owner.epoch) owner = {epoch, process};
}

bool Tracker::OnMapperState(const MapperState& state) {
  const auto owner = owners_.find(state.map);
  // It hung, and does not know yet that it lost the map.
  if (owner != owners_.end() && state.epoch < owner->second.epoch) return false;
  if (!Concerns(state)) return false;
  NoteOwner(state.map, state.epoch, state.process);
  mapper_state_ = state;
  if (awaited_keyframe_ &&
      (state.last_keyframe == *awaited_keyframe_ || state.refused_keyframe == *awaited_keyframe_)) {
    awaited_keyframe_.reset();
  }
  if (state.refused_keyframe.IsValid()) {
    unacknowledged_.erase(state.refused_keyframe);
    if (beginning_.sent() && beginning_.sent()->second.data->id == state.refused_keyframe) {
      DropPair();
      ++refused_pairs_;
    }
  }
  return true;
}

void Tracker::ApplyPending() {
  const Stopwatch stopwatch;
  for (const MapId id : maps_.Waiting()) {
    std::optional<MapMotion> motion;
    if (id == active_map_) motion.emplace(maps_.map(id), reference_keyframe_);
    for (const MapDelta& delta : maps_.ApplyPending(id)) OnApplied(maps_.map(id), delta);
    const auto new_from_old = motion ? motion->Measure(maps_.map(id)) : std::nullopt;
    if (new_from_old) MoveWithMap(*new_from_old);
  }
  CompleteFusions();
  TakeResidual();
  stage_times_.Add("apply", stopwatch.Milliseconds());
}

/// What is taken out of the map's keyframes is taken out of the frames that are tracked in it. A young map may not know
/// of any yet.
void Tracker::TakeResidual() {
  if (!active_map_.IsValid()) return;
  for (const CameraResidual& known : ActiveMap().residuals()) {
    if (known.camera == camera_.pinhole) camera_.residual = known.residual;
  }
}

void Tracker::OnApplied(const Map& map, const MapDelta& delta) {
  for (const MapDelta::KeyFrameState& state : delta.keyframes) Acknowledge(state.id);
  Epoch& epoch = applied_epochs_[map.id()];
  if (delta.IsSnapshot() && delta.epoch > epoch) TakeBack(delta);
  epoch = delta.epoch;
  for (const MapDelta::RemovedKeyFrame& removed : delta.removed_keyframes) {
    if (reference_keyframe_ == removed.id && map.id() == active_map_) reference_keyframe_ = removed.anchor;
  }
  history_.OnDelta(map, delta);
  if (map.id() != active_map_) return;
  // What the tracker holds of the map follows merges and new positions.
  std::map<MapPointId, MapPointId> replaced;
  for (const MapDelta::RemovedPoint& removed : delta.removed_points) replaced[removed.id] = removed.replaced_by;
  std::vector<ReferenceLandmark> kept;
  for (ReferenceLandmark& landmark : reference_) {
    for (auto by = replaced.find(landmark.id); by != replaced.end(); by = replaced.find(landmark.id))
      landmark.id = by->second;
    const MapPoint* point = landmark.id.IsValid() ? map.FindPoint(landmark.id) : nullptr;
    if (point == nullptr) continue;
    landmark.position_in_map = point->position_in_map.cast<double>();
    kept.push_back(landmark);
  }
  reference_ = std::move(kept);
}

void Tracker::Acknowledge(KeyFrameId id) {
  const auto found = unacknowledged_.find(id);
  if (found == unacknowledged_.end()) return;
  acknowledged_.push_back(std::move(found->second));
  unacknowledged_.erase(found);
  if (acknowledged_.size() > kKeptAcknowledged) acknowledged_.pop_front();
}

/// What the last owner had acknowledged and its successor's map has not: the delta had come here, and to nobody who
/// lives besides.
void Tracker::TakeBack(const MapDelta& snapshot) {
  for (const MapDelta::RemovedKeyFrame& removed : snapshot.removed_keyframes) {
    const auto found = std::find_if(acknowledged_.begin(), acknowledged_.end(),
                                    [&](const auto& message) { return message.data.id == removed.id; });
    if (found == acknowledged_.end()) continue;
    spdlog::info("the new owner of map {} has not got keyframe {}: it is sent again", ToString(snapshot.map),
                 ToString(removed.id));
    awaited_keyframe_ = removed.id;
    unacknowledged_[removed.id] = std::move(*found);
    acknowledged_.erase(found);
  }
}

void Tracker::MoveWithMap(const Sim3d& new_from_old) {
  if (!last_frame_) return;
  last_frame_->camera_from_map = TransformPose(last_frame_->camera_from_map, new_from_old);
  velocity_model_.MoveWithMap(new_from_old);
  ring_.MoveWithMap(active_map_, new_from_old);
}

std::optional<KeyFrameId> Tracker::AwaitedKeyFrame() const {
  return awaited_keyframe_;
}

}  // namespace portolan
