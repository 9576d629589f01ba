#include "tool/map_export.h"

#include <algorithm>
#include <array>

#include "base/atomic_file.h"
#include "dataset/trajectory_io.h"

namespace portolan {
namespace {

using Color = std::array<uint8_t, 3>;
constexpr Color kFew{60, 80, 170}, kMany{250, 220, 60}, kCamera{230, 50, 40};
constexpr size_t kManyKeyFrames = 10;

/// Between kFew at two keyframes and kMany at kManyKeyFrames.
Color ColorOf(size_t keyframes) {
  const double share =
      std::clamp((static_cast<double>(keyframes) - 2) / (static_cast<double>(kManyKeyFrames) - 2), 0.0, 1.0);
  Color color;
  for (size_t i = 0; i < color.size(); ++i) color[i] = static_cast<uint8_t>(kFew[i] + share * (kMany[i] - kFew[i]));
  return color;
}

void AddVertex(const Eigen::Vector3f& position, const Color& color, std::string* file) {
  file->append(reinterpret_cast<const char*>(position.data()), 3 * sizeof(float));
  file->append(reinterpret_cast<const char*>(color.data()), color.size());
}

}  // namespace

Status WriteMapPly(const std::string& path, const Map& map) {
  std::string file = "ply\nformat binary_little_endian 1.0\ncomment Portolan map " + ToString(map.id()) +
                     ": points, then camera centres\nelement vertex " +
                     std::to_string(map.points().size() + map.keyframes().size()) +
                     "\nproperty float x\nproperty float y\nproperty float z\nproperty uchar red\nproperty uchar "
                     "green\nproperty uchar blue\nend_header\n";
  for (const MapPointId id : map.SortedPointIds()) {
    const MapPoint& point = map.point(id);
    AddVertex(point.position_in_map, ColorOf(point.observations.size()), &file);
  }
  for (const auto& [id, keyframe] : map.keyframes())
    AddVertex(keyframe.camera_from_map.Inverse().translation.cast<float>(), kCamera, &file);
  return WriteFileAtomically(path, file);
}

Status WriteKeyFrameTrajectory(const std::string& path, const Map& map) {
  Trajectory trajectory;
  for (const auto& [id, keyframe] : map.keyframes())
    trajectory.push_back({keyframe.data->stamp, keyframe.camera_from_map.Inverse(), 0});
  std::stable_sort(trajectory.begin(), trajectory.end(),
                   [](const TrajectoryPose& a, const TrajectoryPose& b) { return a.stamp < b.stamp; });
  return WriteTrajectory(path, trajectory, false);
}

}  // namespace portolan
