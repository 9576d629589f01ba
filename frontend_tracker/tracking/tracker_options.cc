#include "tracking/tracker_options.h"

#include <string>

namespace portolan {
namespace {

template <class T>
void Require(bool holds, const char* key, const T& value, const char* expected, std::string* problem) {
  if (holds || !problem->empty()) return;
  *problem = std::string(key) + " is " + std::to_string(value) + ", expected " + expected;
}

}  // namespace

Status TrackerOptions::Check() const {
  if (Status status = orb.Check(); !status) return status;
  std::string problem;
  Require(map_tracking.coarse_radius_px > 0, "tracker.map_tracking.coarse_radius_px", map_tracking.coarse_radius_px,
          "more than 0", &problem);
  Require(map_tracking.wide_radius_px >= map_tracking.coarse_radius_px, "tracker.map_tracking.wide_radius_px",
          map_tracking.wide_radius_px, "at least coarse_radius_px", &problem);
  Require(map_tracking.fine_radius_px > 0, "tracker.map_tracking.fine_radius_px", map_tracking.fine_radius_px,
          "more than 0", &problem);
  Require(map_tracking.max_distance >= 0 && map_tracking.max_distance <= 256, "tracker.map_tracking.max_distance",
          map_tracking.max_distance, "0 to 256", &problem);
  Require(map_tracking.ratio > 0 && map_tracking.ratio <= 1, "tracker.map_tracking.ratio", map_tracking.ratio,
          "above 0, at most 1", &problem);
  Require(map_tracking.min_points >= 4, "tracker.map_tracking.min_points", map_tracking.min_points, "at least 4",
          &problem);
  Require(map_tracking.max_local_keyframes >= 2, "tracker.map_tracking.max_local_keyframes",
          map_tracking.max_local_keyframes, "at least 2", &problem);
  Require(keyframe.min_points >= 4, "tracker.keyframe.min_points", keyframe.min_points, "at least 4", &problem);
  Require(keyframe.young_min_points >= 4, "tracker.keyframe.young_min_points", keyframe.young_min_points, "at least 4",
          &problem);
  Require(keyframe.min_quality >= 0 && keyframe.min_quality < 1, "tracker.keyframe.min_quality", keyframe.min_quality,
          "0 to 1", &problem);
  Require(keyframe.distance_factor > 0, "tracker.keyframe.distance_factor", keyframe.distance_factor, "more than 0",
          &problem);
  Require(keyframe.gap_distance_factor > 0, "tracker.keyframe.gap_distance_factor", keyframe.gap_distance_factor,
          "more than 0", &problem);
  Require(initializer.min_matches >= 8, "tracker.initializer.min_matches", initializer.min_matches, "at least 8",
          &problem);
  Require(initializer.min_baseline_px > 0, "tracker.initializer.min_baseline_px", initializer.min_baseline_px,
          "more than 0", &problem);
  Require(relocalizer.max_candidates >= 1, "tracker.relocalizer.max_candidates", relocalizer.max_candidates,
          "at least 1", &problem);
  Require(min_tracked_points >= 4, "tracker.min_tracked_points", min_tracked_points, "at least 4", &problem);
  Require(min_tracked_quality >= 0 && min_tracked_quality < 1, "tracker.min_tracked_quality", min_tracked_quality,
          "0 to 1", &problem);
  Require(max_map_keyframes == 0 || max_map_keyframes >= 5, "tracker.max_map_keyframes", max_map_keyframes,
          "0, or at least 5", &problem);
  Require(max_lost_frames >= 1, "tracker.max_lost_frames", max_lost_frames, "at least 1", &problem);
  if (!problem.empty()) return Error{problem};
  return Ok{};
}

}  // namespace portolan
