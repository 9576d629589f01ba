#include "tracking/keyframe_policy.h"

#include <algorithm>
#include <limits>
#include <utility>

namespace portolan {
namespace {

constexpr int kFewPoints = 50;  // a frame inside a map tracks some hundreds
// Keyframes that see a landmark: one that only its keyframe and one neighbour see is new, and whether it can be tracked
// is not known yet.
constexpr size_t kNew = 2, kEstablished = 3;
// s = n / m above which a few landmarks are sure: past halls' walls 0.93 and more; in office_walk's jerks, where their
// pose may be wrong, 0.5 to 0.8.
constexpr double kSureQuality = 0.85;

/// Mean depth of the landmarks that a frame tracks, map units; 0 if none.
double MeanDepth(const Map& map, const Frame& frame) {
  double sum = 0;
  int count = 0;
  for (const MapPointId id : frame.landmarks) {
    const MapPoint* point = id.IsValid() ? map.FindPoint(id) : nullptr;
    if (point == nullptr) continue;
    sum += (frame.camera_from_map * point->position_in_map.cast<double>()).z();
    ++count;
  }
  return count > 0 ? sum / count : 0;
}

/// The keyframe nearest to a place, but for `except` (may be none), and how far it is; infinitely far if there is none.
std::pair<const KeyFrame*, double> NearestKeyFrame(const Map& map, const Eigen::Vector3d& place_in_map,
                                                   KeyFrameId except) {
  std::pair<const KeyFrame*, double> nearest{nullptr, std::numeric_limits<double>::infinity()};
  for (const auto& [id, keyframe] : map.keyframes()) {
    const double distance = (keyframe.camera_from_map.TargetOriginInSource() - place_in_map).norm();
    if (id != except && distance < nearest.second) nearest = {&keyframe, distance};
  }
  return nearest;
}

double DistanceToNearestKeyFrame(const Map& map, const Rigid3d& camera_from_map) {
  return NearestKeyFrame(map, camera_from_map.TargetOriginInSource(), KeyFrameId()).second;
}

/// Whether the camera is farther from its nearest keyframe than that one is from the next: beyond them, and not in
/// between.
bool IsBeyondKeyFrames(const Map& map, const Rigid3d& camera_from_map) {
  const auto [nearest, distance] = NearestKeyFrame(map, camera_from_map.TargetOriginInSource(), KeyFrameId());
  if (nearest == nullptr) return true;
  return distance > NearestKeyFrame(map, nearest->camera_from_map.TargetOriginInSource(), nearest->data->id).second;
}

}  // namespace

void KeyFramePolicy::StartMap(const Map& map) {
  first_distance_over_depth_ = 0;
  if (map.keyframes().size() < 2) return;
  const KeyFrame& first = map.keyframes().begin()->second;
  const KeyFrame& second = std::next(map.keyframes().begin())->second;
  const double distance =
      (first.camera_from_map.TargetOriginInSource() - second.camera_from_map.TargetOriginInSource()).norm();
  const double depth = map.MedianDepth(first.data->id);
  if (depth > 0) first_distance_over_depth_ = distance / depth;
}

bool KeyFramePolicy::IsQualityGood(const Map& map, const Frame& frame) const {
  if (frame.num_inliers < options_.MinPoints(map)) return false;
  return frame.Quality() > options_.min_quality || frame.num_inliers >= options_.sure_points;
}

bool KeyFramePolicy::IsFar(const Map& map, const Frame& frame, double factor) const {
  const double depth = MeanDepth(map, frame);
  if (depth <= 0) return false;
  const double distance = DistanceToNearestKeyFrame(map, frame.camera_from_map);
  return distance / depth > factor * first_distance_over_depth_;  // paper Eq. (7)
}

bool KeyFramePolicy::HasLost(const Map& map, const Frame& frame, double share, size_t observations) const {
  const KeyFrame* reference = map.FindKeyFrame(frame.reference);
  if (reference == nullptr) return false;
  const auto seen = std::count_if(reference->landmarks.begin(), reference->landmarks.end(), [&](MapPointId id) {
    return id.IsValid() && map.point(id).observations.size() >= observations;
  });
  return frame.num_inliers < share * static_cast<double>(seen);
}

bool KeyFramePolicy::IsInKnownPlace(const Frame& frame) const {
  const KeyFrameId reference = frame.reference;
  const bool is_own = reference.robot() == last_keyframe_.robot() && reference.session() == last_keyframe_.session();
  return !is_own || reference.sequence() + static_cast<uint32_t>(options_.recent_keyframes) < last_keyframe_.sequence();
}

bool KeyFramePolicy::IsViewNew(const Map& map, const Frame& frame) const {
  const double share = IsInKnownPlace(frame) ? options_.known_place_overlap : options_.max_reference_overlap;
  if (HasLost(map, frame, share, kEstablished)) return true;
  // In a fast turn nearly all landmarks are new, and gone before a third keyframe sees them.
  const bool runs_out = frame.num_inliers < options_.few_points && frame.Quality() > kSureQuality;
  return runs_out && HasLost(map, frame, options_.urgent_reference_overlap, kNew);
}

bool KeyFramePolicy::IsLeaving(const Map& map, const Frame& frame) const {
  return frame.num_inliers < kFewPoints || (IsFar(map, frame, 1.0) && IsBeyondKeyFrames(map, frame.camera_from_map));
}

bool KeyFramePolicy::IsUrgent(const Map& map, const Frame& frame) const {
  const bool runs_out = frame.num_inliers < options_.few_points && IsViewNew(map, frame);
  return runs_out || IsFar(map, frame, options_.urgent_distance_factor) ||
         HasLost(map, frame, options_.urgent_reference_overlap, kEstablished);
}

KeyFramePolicy::Decision KeyFramePolicy::Decide(const Map& map, const Frame& frame, bool mapper_idle) const {
  const bool is_needed = mapper_idle && frame.num_inliers >= options_.MinPoints(map) && IsUrgent(map, frame);
  if (!IsQualityGood(map, frame) && !is_needed) return Decision::kNo;
  if (SecondsBetween(last_keyframe_stamp_, frame.stamp) < options_.min_interval_s) return Decision::kNo;
  if (!IsFarEnough(map, frame) && !IsViewNew(map, frame)) return Decision::kNo;
  if (mapper_idle) return Decision::kInsert;
  return IsUrgent(map, frame) ? Decision::kInterrupt : Decision::kNo;
}

}  // namespace portolan
