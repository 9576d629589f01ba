#include "tracking/frame_ring.h"

#include <unordered_map>

#include "base/statistics.h"

namespace portolan {

void FrameRing::Add(const Frame& frame) {
  if (!frames_.empty() && frames_.back().map != frame.map) frames_.clear();
  failed_.clear();
  frames_.push_back(frame);
  if (frames_.size() > capacity_) frames_.pop_front();
}

void FrameRing::AddFailed(const Frame& frame) {
  failed_.push_back(frame);
  if (failed_.size() > capacity_) failed_.pop_front();
}

void FrameRing::Clear() {
  frames_.clear();
  failed_.clear();
}

void FrameRing::MoveWithMap(MapId map, const Sim3d& map_from_old) {
  for (Frame& frame : frames_) {
    frame.map = map;
    frame.camera_from_map = TransformPose(frame.camera_from_map, map_from_old);
  }
  for (Frame& frame : failed_) frame.camera_from_map = TransformPose(frame.camera_from_map, map_from_old);
}

std::vector<Frame> FrameRing::Overlapping(double min_baseline_px, size_t min_common) const {
  if (frames_.empty()) return {};
  size_t first = frames_.size() - 1;
  while (first > 0) {
    size_t common = 0;
    const double motion_px = CompensatedMotionPx(frames_[first - 1], frames_.back(), &common);
    if (common < min_common) break;
    --first;
    if (motion_px >= min_baseline_px) break;
  }
  return {frames_.begin() + static_cast<ptrdiff_t>(first), frames_.end()};
}

double CompensatedMotionPx(const Frame& first, const Frame& second, size_t* num_common) {
  std::unordered_map<MapPointId, size_t> feature_of;
  for (size_t i = 0; i < first.landmarks.size(); ++i) {
    if (first.landmarks[i].IsValid()) feature_of.emplace(first.landmarks[i], i);
  }
  const PinholeCamera& camera = first.data->camera;
  const Eigen::Quaterniond first_from_second =
      first.camera_from_map.rotation * second.camera_from_map.rotation.conjugate();
  std::vector<double> motions_px;
  for (size_t i = 0; i < second.landmarks.size(); ++i) {
    const auto same = feature_of.find(second.landmarks[i]);
    if (!second.landmarks[i].IsValid() || same == feature_of.end()) continue;
    const Eigen::Vector3d ray = first_from_second * camera.Unproject(second.data->features.pixels_px[i].cast<double>());
    if (ray.z() <= 0) continue;
    motions_px.push_back((camera.Project(ray) - first.data->features.pixels_px[same->second].cast<double>()).norm());
  }
  *num_common = motions_px.size();
  return Quantile(std::move(motions_px), 0.5);
}

}  // namespace portolan
