#include "tracking/camera_reach.h"

#include <algorithm>

namespace portolan {
namespace {

constexpr double kRememberedS = 4.0;  // after that a camera may be anywhere: carried off in the dark, or a film's cut
constexpr double kSpeedOverS = 0.5;   // what its speed is measured over
constexpr double kSpeedFactor = 2.0;  // faster since; with 3 a wall 15 m off was in reach of 3.7 m gone (halls)
// Of the depth of what it saw: it may have stood still, or its last poses been poor.
constexpr double kSlack = 0.5;
constexpr double kDepthsPerSecond = 0.5;  // of the same depth: at a walk past a wall 2 m away

/// Whether they are of one map and one tracker's time.
bool IsWithin(const FrameRecord& record, const FrameRecord& latest, double seconds) {
  return record.map == latest.map && SecondsBetween(record.stamp, latest.stamp) <= seconds;
}

}  // namespace

std::optional<CameraReach> ReachOfCamera(const FrameHistory& history, const Map& map, Timestamp now) {
  if (history.records().empty()) return std::nullopt;
  auto record = history.records().rbegin();
  const FrameRecord& latest = record->second;
  const double elapsed_s = SecondsBetween(latest.stamp, now);
  if (latest.map != map.id() || elapsed_s > kRememberedS) return std::nullopt;
  const auto last_pose = FrameHistory::CameraFromMap(map, latest);
  if (!last_pose) return std::nullopt;

  CameraReach reach;
  reach.centre_in_map = last_pose->TargetOriginInSource();
  double speed = 0;  // map units per second, the fastest
  for (++record; record != history.records().rend() && IsWithin(record->second, latest, kSpeedOverS); ++record) {
    const auto pose = FrameHistory::CameraFromMap(map, record->second);
    const double seconds = SecondsBetween(record->second.stamp, latest.stamp);
    if (pose && seconds > 0)
      speed = std::max(speed, (pose->TargetOriginInSource() - reach.centre_in_map).norm() / seconds);
  }
  const double depth = map.MedianDepth(latest.anchor);
  reach.radius = kSlack * depth + elapsed_s * std::max(kSpeedFactor * speed, kDepthsPerSecond * depth);
  return reach;
}

}  // namespace portolan
