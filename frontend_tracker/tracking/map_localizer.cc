#include "tracking/map_localizer.h"

#include <algorithm>
#include <unordered_set>

namespace portolan {
namespace {

constexpr size_t kNearKeyFrames = 12;      // looked at more closely
constexpr double kMinViewCosine = 0.5;     // 60 degrees between the optical axes: about the width of a picture
constexpr size_t kReferenceKeyFrames = 3;  // whose landmarks together cover a view

bool IsInPicture(const PinholeCamera& camera, const Eigen::Vector3d& in_camera) {
  return in_camera.z() > 0 && camera.Contains(camera.Project(in_camera));
}

/// The keyframes that stand nearest, of those that look the same way.
std::vector<KeyFrameId> NearKeyFrames(const Map& map, const Rigid3d& camera_from_map) {
  const Eigen::Vector3d centre = camera_from_map.TargetOriginInSource();
  const Eigen::Vector3d axis = camera_from_map.rotation.conjugate() * Eigen::Vector3d::UnitZ();
  std::vector<std::pair<double, KeyFrameId>> near;
  for (const auto& [id, keyframe] : map.keyframes()) {
    const Eigen::Vector3d its_axis = keyframe.camera_from_map.rotation.conjugate() * Eigen::Vector3d::UnitZ();
    if (axis.dot(its_axis) < kMinViewCosine) continue;
    near.emplace_back((keyframe.camera_from_map.TargetOriginInSource() - centre).squaredNorm(), id);
  }
  const size_t number = std::min(near.size(), kNearKeyFrames);
  std::partial_sort(near.begin(), near.begin() + static_cast<ptrdiff_t>(number), near.end());
  std::vector<KeyFrameId> keyframes;
  for (size_t i = 0; i < number; ++i) keyframes.push_back(near[i].second);
  return keyframes;
}

}  // namespace

std::vector<KeyFrameId> KeyFramesInView(const Map& map, const PinholeCamera& camera, const Rigid3d& camera_from_map,
                                        size_t most) {
  std::vector<std::pair<int, KeyFrameId>> seen;  // negative number of landmarks: most first, then the nearest
  for (const KeyFrameId id : NearKeyFrames(map, camera_from_map)) {
    int landmarks = 0;
    for (const MapPointId point : map.keyframe(id).landmarks) {
      landmarks += IsInPicture(camera, camera_from_map * map.point(point).position_in_map.cast<double>()) ? 1 : 0;
    }
    if (landmarks > 0) seen.emplace_back(-landmarks, id);
  }
  std::stable_sort(seen.begin(), seen.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  std::vector<KeyFrameId> keyframes;
  for (size_t i = 0; i < std::min(most, seen.size()); ++i) keyframes.push_back(seen[i].second);
  return keyframes;
}

std::vector<ReferenceLandmark> LandmarksInView(const Map& map, const PinholeCamera& camera,
                                               const Rigid3d& camera_from_map) {
  std::vector<ReferenceLandmark> landmarks;
  std::unordered_set<MapPointId> taken;
  for (const KeyFrameId id : KeyFramesInView(map, camera, camera_from_map, kReferenceKeyFrames)) {
    const KeyFrame& keyframe = map.keyframe(id);
    if (!keyframe.data->features.HasAppearance()) continue;
    for (const ReferenceLandmark& landmark : ReferenceLandmarks(map, *keyframe.data, keyframe.landmarks.ByFeature())) {
      if (taken.insert(landmark.id).second) landmarks.push_back(landmark);
    }
  }
  return landmarks;
}

bool MapLocalizer::LocalizeNear(const Map& map, const Rigid3d& predicted_camera_from_map, Frame* frame) {
  const MapTrackingOptions& options = options_.map_tracking;
  const auto reference = LandmarksInView(map, frame->data->camera, predicted_camera_from_map);
  if (static_cast<int>(reference.size()) < options_.relocalizer.min_inliers) return false;
  int inliers = tracker_.TrackCoarse(map, reference, predicted_camera_from_map, options.coarse_radius_px, frame);
  if (inliers < options.min_coarse_inliers) {
    inliers = tracker_.TrackCoarse(map, reference, predicted_camera_from_map, options.wide_radius_px, frame);
  }
  if (inliers >= options.min_points && tracker_.TrackFine(map, frame) >= options_.relocalizer.min_inliers) return true;
  const auto nearest = KeyFramesInView(map, frame->data->camera, predicted_camera_from_map, 1);
  return !frame->data->bow.empty() && !nearest.empty() &&
         relocalizer_.TrackKeyFrame(map, nearest.front(), options_.relocalizer.min_inliers, &tracker_, frame) &&
         Relocalizer::IsSure(*frame);
}

bool MapLocalizer::LocalizeByWords(const Map& map, const KeyFrameIndex& index, Frame* frame) {
  return relocalizer_.Relocalize(map, index, std::nullopt, &tracker_, frame);
}

}  // namespace portolan
