#include "tracking/joined_trajectory.h"

#include <algorithm>
#include <cmath>

namespace portolan {
namespace {

constexpr size_t kSpeedFrames = 20;
constexpr size_t kVelocityFrames = 6;  // on each side of a gap: in a turn the direction is soon another
constexpr double kMaxGapS = 5.0;       // over which the camera is assumed to have gone on

/// Median speed between consecutive poses, lengths per second; 0 if it can't be told.
double MedianSpeed(const Trajectory& poses) {
  std::vector<double> speeds;
  for (size_t i = 1; i < poses.size(); ++i) {
    const double dt = SecondsBetween(poses[i - 1].stamp, poses[i].stamp);
    if (dt <= 0) continue;
    speeds.push_back((poses[i].world_from_camera.translation - poses[i - 1].world_from_camera.translation).norm() / dt);
  }
  if (speeds.empty()) return 0;
  const auto middle = speeds.begin() + static_cast<ptrdiff_t>(speeds.size() / 2);
  std::nth_element(speeds.begin(), middle, speeds.end());
  return *middle;
}

/// From the first pose to the last, lengths per second in the frame of the poses; zero if it can't be told.
Eigen::Vector3d MeanVelocity(Trajectory::const_iterator first, Trajectory::const_iterator last) {
  const double dt = SecondsBetween(first->stamp, last->stamp);
  if (dt <= 0) return Eigen::Vector3d::Zero();
  return (last->world_from_camera.translation - first->world_from_camera.translation) / dt;
}

/// By stamp, the orientations of frames by dead reckoning.
using Orientations = std::map<Timestamp, Eigen::Quaterniond>;

/// How the camera turned between two frames, if dead reckoning knows of both; else not at all.
Eigen::Quaterniond TurnBetween(const Orientations& camera_from_start, Timestamp first, Timestamp second) {
  const auto a = camera_from_start.find(first), b = camera_from_start.find(second);
  if (a == camera_from_start.end() || b == camera_from_start.end()) return Eigen::Quaterniond::Identity();
  return b->second * a->second.conjugate();
}

/// The similarity that lets the camera go on from `before` (joined frame) with `after` (a new map's first poses).
Sim3d Continue(const Trajectory& before, const Trajectory& after, const Orientations& camera_from_start) {
  const Trajectory last(before.end() - static_cast<ptrdiff_t>(std::min(before.size(), kSpeedFrames)), before.end());
  const Trajectory first(after.begin(), after.begin() + static_cast<ptrdiff_t>(std::min(after.size(), kSpeedFrames)));
  const double speed_before = MedianSpeed(last), speed_after = MedianSpeed(first);
  const double scale = speed_before > 0 && speed_after > 0 ? speed_before / speed_after : 1.0;
  const Rigid3d& from = last.back().world_from_camera;
  const Rigid3d& to = first.front().world_from_camera;
  const Eigen::Quaterniond turn = TurnBetween(camera_from_start, last.back().stamp, first.front().stamp);
  const Eigen::Quaterniond rotation = (from.rotation * turn.conjugate() * to.rotation.conjugate()).normalized();
  // Between the two it went on as the mean of how it went before and after.
  const auto frames = static_cast<ptrdiff_t>(std::min({before.size(), after.size(), kVelocityFrames}));
  const Eigen::Vector3d velocity =
      0.5 * (MeanVelocity(before.end() - frames, before.end() - 1) +
             scale * (rotation * MeanVelocity(after.begin(), after.begin() + (frames - 1))));
  const double gap_s = std::clamp(SecondsBetween(last.back().stamp, first.front().stamp), 0.0, kMaxGapS);
  return Sim3d(scale, rotation, from.translation + gap_s * velocity - scale * (rotation * to.translation));
}

Rigid3d InJoined(const Sim3d& joined_from_map, const Rigid3d& camera_from_map) {
  return TransformPose(camera_from_map, joined_from_map).Inverse();
}

/// The poses of all maps in `joined` from before a map's first one; all if none is.
Trajectory Before(const Trajectory& joined, Timestamp first) {
  Trajectory before;
  for (const TrajectoryPose& pose : joined) {
    if (pose.stamp < first) before.push_back(pose);
  }
  return before.empty() ? joined : before;
}

/// From any of the maps that are placed already, the first first.
std::optional<Sim3d> PlaceByLinks(MapId map, const std::vector<MapId>& placed,
                                  const std::map<MapId, Sim3d>& joined_from_map, const LinkGraph& links) {
  for (const MapId other : placed) {
    if (const auto other_from_map = links.Find(other, map)) return joined_from_map.at(other) * *other_from_map;
  }
  return std::nullopt;
}

bool IsEarlier(const TrajectoryPose& a, const TrajectoryPose& b) {
  return a.stamp < b.stamp;
}

}  // namespace

RunTrajectories MakeTrajectories(const FrameHistory& history, const std::map<MapId, MapReplica>& replicas,
                                 const LinkGraph& links) {
  RunTrajectories result;
  std::map<MapId, Trajectory> own;
  Orientations camera_from_start;
  std::vector<MapId> order;
  for (const auto& [number, record] : history.records()) {
    const auto replica = replicas.find(record.map);
    if (replica == replicas.end()) continue;
    const auto camera_from_map = FrameHistory::CameraFromMap(replica->second.map(), record);
    if (!camera_from_map) continue;
    const auto [entry, is_new] = result.map_numbers.emplace(record.map, static_cast<int>(result.map_numbers.size()));
    if (is_new) order.push_back(record.map);
    const TrajectoryPose pose{record.stamp, camera_from_map->Inverse(), entry->second};
    result.per_map.push_back(pose);
    own[record.map].push_back(pose);
    if (record.camera_from_start) camera_from_start[record.stamp] = *record.camera_from_start;
    if (record.online) result.online.push_back({record.stamp, record.online_camera_from_map.Inverse(), entry->second});
  }
  std::vector<MapId> placed;
  for (const MapId map : order) {
    std::optional<Sim3d> joined_from_map =
        placed.empty() ? Sim3d() : PlaceByLinks(map, placed, result.joined_from_map, links);
    if (!joined_from_map) {
      joined_from_map = Continue(Before(result.joined, own[map].front().stamp), own[map], camera_from_start);
      result.unlinked_maps.push_back(map);
    }
    result.joined_from_map[map] = *joined_from_map;
    placed.push_back(map);
    for (const TrajectoryPose& pose : own[map]) {
      result.joined.push_back({pose.stamp, InJoined(*joined_from_map, pose.world_from_camera.Inverse()), pose.map});
    }
    std::stable_sort(result.joined.begin(), result.joined.end(), IsEarlier);
    for (const auto& [id, keyframe] : replicas.at(map).map().keyframes()) {
      result.keyframes.push_back(
          {keyframe.data->stamp, InJoined(*joined_from_map, keyframe.camera_from_map), result.map_numbers[map]});
    }
  }
  std::stable_sort(result.keyframes.begin(), result.keyframes.end(), IsEarlier);
  return result;
}

}  // namespace portolan
