// Going from map to map (paper Sec. 3.4 and 6, the tracker's part): over into another one, and along when two are
// fused.

#include <spdlog/spdlog.h>

#include <algorithm>
#include <cstdlib>
#include <utility>

#include "tracking/tracker.h"

namespace portolan {
namespace {

constexpr int kMoveFrames = 30;              // tried, before a move is given up
constexpr double kSnapshotPatienceS = 10.0;  // for the map itself to come
constexpr int kWordsEvery = 5;               // frames near the predicted pose that fail, to one by words
// Frames, to one that is localised in the map just left too; the others take one from before in turn.
constexpr int kLookBackEvery = 2;
constexpr int kLookBackFrames = 90;        // after that the camera has seen what the two have in common
constexpr size_t kLookBackOverlaps = 60;   // enough: the longer their way, the surer the scale
constexpr size_t kLinkedMapsPerFrame = 2;  // tried by their Sim3
constexpr int kLeavingFrames = 3;          // one after another, for a full map to end there
// A picture or two that the active map does not explain are no reason to leave it.
constexpr int kFailedFramesFirst = 2;
// On the way to a map that is tried by its Sim3: drift may show another place that looks alike.
constexpr int kMaxLinks = 2;
constexpr size_t kMapsByWordsPerFrame = 2;  // tried by words: the rest has its turn with later frames
// That a linked map must have of the points which the full map tracks, to be gone over into.
constexpr double kMinShareOfPoints = 0.5;

}  // namespace

void Tracker::Resume(const std::vector<FrameRecord>& frames) {
  history_.Restore(frames);
  for (const FrameRecord& frame : frames) maps_.Follow(frame.map, true);
}

void Tracker::AskAtlas(const std::string& kind, MapId map, MapId other, const std::optional<Sim3d>& map_from_other,
                       const std::string& argument) {
  Request request;
  request.kind = kind;
  request.map = map;
  request.other = other;
  request.map_from_other = map_from_other.value_or(Sim3d());
  request.argument = argument;
  requests_.push_back(std::move(request));
}

void Tracker::OnReply(const Request& request, const Reply& reply) {
  if (request.kind == "locate") queries_.OnReply(reply.ok);
  if (request.kind == "new_map" && reply.ok)
    queries_.NoteMapsInAtlas(static_cast<size_t>(std::max(0, std::atoi(reply.text.c_str()))));
}

void Tracker::OnCommand(const Command& command) {
  const bool is_mine = command.robot == robot_;
  switch (command.kind) {
    case CommandKind::kGrantOwnership:
      return NoteOwner(command.map, command.epoch, command.owner);
    case CommandKind::kActivateMap:
      if (command.other.IsValid() ? command.other == active_map_ : is_mine) PlanMove(command);
      return;
    case CommandKind::kFuseMaps:
      // Whoever has been in `other` needs `map` now; for all others it is where these two lie.
      if (maps_.Has(command.other)) maps_.Follow(command.map, true);
      fusions_.push_back(command);
      return;
    case CommandKind::kLinkMaps:
      if (!links_.AreLinked(command.map, command.other))
        links_.Link({command.map, {}}, {command.other, {}}, command.map_from_other);
      return;
    case CommandKind::kNewMap:
      if (is_mine && active_map_.IsValid() && !beginning_.map().IsValid() && !options_.localization_only) StartNewMap();
      return;
    case CommandKind::kLocalizeOnly:
    case CommandKind::kMapAgain:
      if (!is_mine) return;
      options_.localization_only = command.kind == CommandKind::kLocalizeOnly;
      if (options_.localization_only) StopBeginning();
      return;
    case CommandKind::kForgetMap:
      return ForgetMap(command.map);
    default:
      return;
  }
}

void Tracker::PlanMove(const Command& command) {
  if (command.map == active_map_ || command.map == beginning_.map()) return;
  maps_.Follow(command.map, true);
  PlannedMove move;
  move.target = command.map;
  move.by_command = true;
  if (command.other.IsValid()) {
    move.target_from_active = command.map_from_other;
  } else if (active_map_.IsValid()) {
    move.target_from_active = links_.Find(command.map, active_map_);
  }
  move_ = move;
}

bool Tracker::IsFull(const Map& map) const {
  return options_.max_map_keyframes > 0 && map.keyframes().size() >= static_cast<size_t>(options_.max_map_keyframes);
}

bool Tracker::ConsiderMapChange(Frame* frame) {
  const Stopwatch stopwatch;
  bool changed = move_ && TryPlannedMove(frame, true);
  const Map& map = ActiveMap();
  leaving_frames_ = !changed && IsFull(map) && keyframe_policy_.IsLeaving(map, *frame) ? leaving_frames_ + 1 : 0;
  if (!move_ && !beginning_.map().IsValid() && !options_.localization_only && leaving_frames_ >= kLeavingFrames) {
    changed = GoOnInLinkedMap(frame, true);
    if (!changed) StartNewMap();
  }
  stage_times_.Add("change_map", stopwatch.Milliseconds());
  return changed;
}

/// Tries to localise the frame in the map that is to be gone into. @param is_tracked whether its pose in the active map
/// is known, not just predicted.
bool Tracker::TryPlannedMove(Frame* frame, bool is_tracked) {
  const Map* target = maps_.Find(move_->target);
  if (!move_->since) move_->since = frame->stamp;
  if (target == nullptr || target->keyframes().empty()) {
    if (target == nullptr || SecondsBetween(*move_->since, frame->stamp) > kSnapshotPatienceS)
      GiveUpMove("the tracker has not got the map");
    return false;
  }
  Frame moved = *frame;
  bool found = false;
  const bool has_prediction = move_->target_from_active && HasPose();
  if (has_prediction)
    found = localizer_.LocalizeNear(*target, TransformPose(frame->camera_from_map, *move_->target_from_active), &moved);
  if (!found && (!has_prediction || move_->frames_tried % kWordsEvery == kWordsEvery - 1)) {
    AddWords(&moved);
    found = localizer_.LocalizeByWords(*target, maps_.index(move_->target), &moved);
  }
  if (found) {
    const PlannedMove move = *move_;
    GoOver(move.target, std::move(moved), is_tracked ? frame : nullptr, move.target_from_active, frame);
    return true;
  }
  if (++move_->frames_tried >= kMoveFrames)
    GiveUpMove("the camera was not localised in it in " + std::to_string(kMoveFrames) + " frames");
  return false;
}

void Tracker::GiveUpMove(const std::string& reason) {
  const PlannedMove move = *move_;
  move_.reset();
  spdlog::info("does not go into map {}: {}", ToString(move.target), reason);
  if (!move.by_command) return;
  ++events_.refusals;
  AskAtlas("refuse_map", move.target, active_map_, std::nullopt, reason);
}

/// Tries maps whose place relative to this one is known. With a frame that is tracked: only one that is better than the
/// full map here.
bool Tracker::GoOnInLinkedMap(Frame* frame, bool is_tracked) {
  if (move_ && !is_tracked && TryPlannedMove(frame, false)) return true;
  if (!is_tracked && lost_frames_ < kFailedFramesFirst) return false;
  size_t tried = 0;
  for (const MapId id : links_.Reachable(active_map_, kMaxLinks)) {
    const Map* map = maps_.Find(id);
    if (map == nullptr || map->keyframes().empty() || id == beginning_.map()) continue;
    const std::optional<Sim3d> map_from_active = links_.Find(id, active_map_);
    const Rigid3d predicted = TransformPose(frame->camera_from_map, *map_from_active);
    if (KeyFramesInView(*map, camera_.pinhole, predicted, 1).empty()) continue;
    if (++tried > kLinkedMapsPerFrame) return false;
    Frame moved = *frame;
    if (!localizer_.LocalizeNear(*map, predicted, &moved)) continue;
    const bool is_better = moved.num_inliers >= kMinShareOfPoints * frame->num_inliers &&
                           (!IsFull(*map) || !keyframe_policy_.IsLeaving(*map, moved));
    if (is_tracked && !is_better) continue;
    GoOver(id, std::move(moved), is_tracked ? frame : nullptr, map_from_active, frame);
    return true;
  }
  return false;
}

/// By words, for a frame of a camera that is lost: in the map it was in, then in the others in turn, those with most
/// mutual activity first.
bool Tracker::RelocalizeAnywhere(Frame* frame) {
  const Stopwatch stopwatch;
  const auto took = [&](bool found) {
    stage_times_.Add("relocalize", stopwatch.Milliseconds());
    return found;
  };
  if (move_ && TryPlannedMove(frame, false)) return took(true);
  if (maps_.replicas().empty()) return false;
  AddWords(frame);
  if (active_map_.IsValid() &&
      relocalizer_.Relocalize(ActiveMap(), maps_.index(active_map_), Reach(frame->stamp), &map_tracker_, frame)) {
    velocity_model_.Reset();
    StopBeginning();
    return took(true);
  }
  const std::vector<MapId> others = OtherMaps();
  for (size_t i = 0; i < std::min(others.size(), kMapsByWordsPerFrame); ++i) {
    const MapId id = others[next_other_map_++ % others.size()];
    Frame moved = *frame;
    if (!localizer_.LocalizeByWords(maps_.map(id), maps_.index(id), &moved)) continue;
    GoOver(id, std::move(moved), nullptr, active_map_.IsValid() ? links_.Find(id, active_map_) : std::nullopt, frame);
    return took(true);
  }
  return took(false);
}

/// Those with keyframes that the camera may be in besides the active one: by mutual activity with it, then those that
/// have no link to it.
std::vector<MapId> Tracker::OtherMaps() const {
  std::vector<MapId> order = links_.Reachable(active_map_);
  for (const auto& [id, replica] : maps_.replicas()) {
    if (std::find(order.begin(), order.end(), id) == order.end()) order.push_back(id);
  }
  const auto is_no_choice = [&](MapId id) {
    const Map* map = maps_.Find(id);
    return id == active_map_ || id == beginning_.map() || map == nullptr || map->keyframes().empty();
  };
  order.erase(std::remove_if(order.begin(), order.end(), is_no_choice), order.end());
  return order;
}

/// The active map is `target` from now on. @param moved the frame as it is localised there. @param before the same
/// frame as it is tracked in the map that is left, or null. @param target_from_active what is known of the two, or
/// none. @param frame becomes `moved`.
void Tracker::GoOver(MapId target, Frame moved, const Frame* before, const std::optional<Sim3d>& target_from_active,
                     Frame* frame) {
  const MapId left = active_map_;
  const Map& map = maps_.map(target);
  const bool is_new_map = move_ && move_->is_new_map && move_->target == target;
  std::optional<Sim3d> link = target_from_active;
  handover_.reset();
  if (before != nullptr) {
    const Overlap overlap = MakeOverlap({map, moved.camera_from_map, moved.landmarks},
                                        {ActiveMap(), before->camera_from_map, before->landmarks});
    if (const auto measured = MeasureLink({overlap})) link = measured;
    handover_ = Handover{target, left, before->reference, {}, {overlap}, 0, 1};
    for (const Frame& earlier : ring_.frames()) {
      if (earlier.map == left && earlier.number != before->number) handover_->earlier.push_back(earlier);
    }
  }
  spdlog::info("frame {}: goes on in map {}, left {}: {} points there, {}", moved.number, ToString(target),
               ToString(left), moved.num_inliers, link ? "scale " + std::to_string(link->scale) : "no link");
  if (link && left.IsValid() && !links_.AreLinked(target, left)) {
    links_.Link({target, moved.reference}, {left, before != nullptr ? before->reference : reference_keyframe_}, *link);
  }
  if (before != nullptr && link) {
    // Exactly through this frame, so that the velocity sees no jump.
    velocity_model_.MoveWithMap(LinkThroughCamera(moved.camera_from_map, before->camera_from_map, link->scale));
  } else {
    velocity_model_.Reset();
    if (before != nullptr) velocity_model_.Update(moved.stamp, moved.camera_from_map);
  }
  if (!is_new_map) {
    // Who only localises says where it is, and nothing of how the two maps lie: the map graph stays what it was.
    const bool is_told = link && !options_.localization_only;
    AskAtlas("enter_map", target, is_told ? left : MapId(), is_told ? link : std::nullopt, "");
    if (left.IsValid()) links_.NoteActivity(target, left);
    if (left.IsValid()) ++events_.switches;
  }
  active_map_ = target;
  move_.reset();
  StopBeginning();
  const auto awaited = awaited_keyframe_ ? unacknowledged_.find(*awaited_keyframe_) : unacknowledged_.end();
  if (awaited == unacknowledged_.end() || awaited->second.map != target) awaited_keyframe_.reset();
  keyframe_policy_.StartMap(map);
  moved.map = target;
  *frame = std::move(moved);
}

/// Some frames after a change are localised in the map that was left too, and some from before it in the one gone into:
/// of one frame alone the link's scale is a per cent off, and what a map knows only by its last frames has depths that
/// err.
void Tracker::LookBack(const Frame& frame) {
  if (!handover_) return;
  Handover& handover = *handover_;
  const Map* left = maps_.Find(handover.left);
  const auto left_from_map =
      left != nullptr && active_map_ == handover.map ? links_.Find(handover.left, handover.map) : std::nullopt;
  if (!left_from_map) return handover_.reset();
  auto overlap = ++handover.frames % kLookBackEvery == 0 ? LookBackWith(frame, *left, *left_from_map)
                                                         : LookBackWithEarlier(*left, *left_from_map);
  if (overlap) handover.overlaps.push_back(std::move(*overlap));
  const bool is_last = handover.frames >= kLookBackFrames || handover.overlaps.size() >= kLookBackOverlaps;
  const bool is_due =
      handover.overlaps.size() == kMinWayFrames || (is_last && handover.overlaps.size() > kMinWayFrames);
  const auto link =
      is_due && handover.overlaps.size() > handover.measured_from ? MeasureLink(handover.overlaps) : std::nullopt;
  if (link) {
    handover.measured_from = handover.overlaps.size();
    links_.Link({handover.map, frame.reference}, {handover.left, handover.left_reference}, *link);
    if (!options_.localization_only) AskAtlas("link_maps", handover.map, handover.left, link, "");
    young_link_.reset();  // this is the better one
    spdlog::info("link of maps {} and {} from {} frames: scale {:.4f}", ToString(handover.map), ToString(handover.left),
                 handover.overlaps.size(), link->scale);
  }
  if (is_last) handover_.reset();
}

/// A frame since the change, in the map that was left.
std::optional<Overlap> Tracker::LookBackWith(const Frame& frame, const Map& left, const Sim3d& left_from_map) {
  Frame there = frame;
  if (!localizer_.LocalizeNear(left, TransformPose(frame.camera_from_map, left_from_map), &there)) return std::nullopt;
  handover_->left_reference = there.reference;
  return MakeOverlap({ActiveMap(), frame.camera_from_map, frame.landmarks},
                     {left, there.camera_from_map, there.landmarks});
}

/// The latest frame from before the change that has not had its turn, in the map gone into.
std::optional<Overlap> Tracker::LookBackWithEarlier(const Map& left, const Sim3d& left_from_map) {
  if (handover_->earlier.empty()) return std::nullopt;
  const Frame before = std::move(handover_->earlier.back());
  handover_->earlier.pop_back();
  Frame here = before;
  if (!localizer_.LocalizeNear(ActiveMap(), TransformPose(before.camera_from_map, left_from_map.Inverse()), &here))
    return std::nullopt;
  return MakeOverlap({ActiveMap(), here.camera_from_map, here.landmarks},
                     {left, before.camera_from_map, before.landmarks});
}

void Tracker::CompleteFusions() {
  for (size_t i = 0; i < fusions_.size();) {
    if (!IsFusionHere(fusions_[i])) {
      ++i;
      continue;
    }
    const Command fusion = fusions_[i];
    fusions_.erase(fusions_.begin() + static_cast<ptrdiff_t>(i));
    CompleteFusion(fusion);
  }
}

/// Whether the replica of `map` holds what the tracker has of `other`: its reference keyframe, or any keyframe if it is
/// elsewhere.
bool Tracker::IsFusionHere(const Command& fusion) const {
  const Map* other = maps_.Find(fusion.other);
  const Map* map = maps_.Find(fusion.map);
  if (other == nullptr || other->keyframes().empty()) return true;
  if (map == nullptr) return false;
  if (fusion.other == active_map_ && other->FindKeyFrame(reference_keyframe_) != nullptr &&
      map->FindKeyFrame(reference_keyframe_) != nullptr)
    return true;
  const auto& keyframes = other->keyframes();
  const auto shared = std::count_if(keyframes.begin(), keyframes.end(),
                                    [&](const auto& entry) { return map->FindKeyFrame(entry.first) != nullptr; });
  if (fusion.other != active_map_) return shared > 0;
  return 2 * static_cast<size_t>(shared) > keyframes.size();  // all came, and just the reference has been removed again
}

void Tracker::CompleteFusion(const Command& fusion) {
  if (backfill_map_ == fusion.other) FinishBackfill();
  const bool was_there = maps_.Has(fusion.other);
  links_.Fuse(fusion.map, fusion.other, fusion.map_from_other);
  history_.Fuse(fusion.map, fusion.other, fusion.map_from_other);
  if (was_there) ++events_.fusions;
  if (active_map_ == fusion.other) GoOnInFused(fusion);
  if (beginning_.old_map() == fusion.other) beginning_.SetOldMap(fusion.map);
  if (move_ && (move_->target == fusion.other || move_->target == active_map_)) move_.reset();
  acknowledged_.clear();  // they are of a map that is no more
  // A keyframe on its way goes to the map that is, where it stands there.
  for (auto& [id, message] : unacknowledged_) {
    if (message.map != fusion.other) continue;
    message.map = fusion.map;
    if (message.kind == KeyFrameKind::kTracked)
      message.camera_from_map = TransformPose(message.camera_from_map, fusion.map_from_other);
    if (auto data = maps_.FindKeyFrameData(id)) maps_.AddKeyFrameData(fusion.map, std::move(data));
  }
  maps_.Drop(fusion.other);
}

/// Pose and velocity pass to the map that took in the active one. Keyframes keep their ids: they tell how the scene
/// around the reference has moved, more exactly than the similarity of the two maps as wholes.
void Tracker::GoOnInFused(const Command& fusion) {
  const Map& map = maps_.map(fusion.map);
  const Sim3d map_from_other =
      MapMotion(maps_.map(fusion.other), reference_keyframe_).Measure(map).value_or(fusion.map_from_other);
  active_map_ = fusion.map;
  MoveWithMap(map_from_other);
  // Many were merged with the map's own.
  if (last_frame_) reference_ = LandmarksInView(map, camera_.pinhole, last_frame_->camera_from_map);
  keyframe_policy_.StartMap(map);
}

void Tracker::ForgetMap(MapId map) {
  if (beginning_.map() == map) beginning_.Stop();
  if (spare_map_ == map) spare_map_ = MapId();
  if (move_ && move_->target == map) move_.reset();
  if (active_map_ == map) {
    active_map_ = MapId();
    state_ = TrackingState::kInitializing;
    reference_.clear();
    reference_keyframe_ = KeyFrameId();
    awaited_keyframe_.reset();
    lost_frames_ = 0;
    velocity_model_.Reset();
    ring_.Clear();
  }
  for (auto next = unacknowledged_.begin(); next != unacknowledged_.end();) {
    next = next->second.map == map ? unacknowledged_.erase(next) : std::next(next);
  }
  links_.Forget(map);
  maps_.Drop(map);
}

}  // namespace portolan
