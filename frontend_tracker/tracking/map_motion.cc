#include "tracking/map_motion.h"

#include "base/statistics.h"

namespace portolan {
namespace {

constexpr size_t kMinLandmarks = 10;  // that both maps hold, for a median to tell the scale

}  // namespace

MapMotion::MapMotion(const Map& map, KeyFrameId keyframe) {
  const KeyFrame* found = map.FindKeyFrame(keyframe);
  if (found == nullptr) return;
  keyframe_ = keyframe;
  camera_from_map_ = found->camera_from_map;
  for (const MapPointId id : found->landmarks) {
    distances_.emplace_back(id, (camera_from_map_ * map.point(id).position_in_map.cast<double>()).norm());
  }
}

std::optional<Sim3d> MapMotion::Measure(const Map& map) const {
  const KeyFrame* keyframe = map.FindKeyFrame(keyframe_);
  if (keyframe == nullptr) return std::nullopt;
  std::vector<double> ratios;
  for (const auto& [id, before] : distances_) {
    const MapPoint* point = map.FindPoint(id);
    if (point == nullptr || before <= 0) continue;
    ratios.push_back((keyframe->camera_from_map * point->position_in_map.cast<double>()).norm() / before);
  }
  Sim3d new_camera_from_old_camera;
  if (ratios.size() >= kMinLandmarks) new_camera_from_old_camera.scale = Quantile(ratios, 0.5);
  return Sim3d(keyframe->camera_from_map.Inverse()) * new_camera_from_old_camera * Sim3d(camera_from_map_);
}

}  // namespace portolan
