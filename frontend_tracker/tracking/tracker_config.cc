#include "tracking/tracker_config.h"

namespace portolan {
namespace {

void ReadOrb(ConfigReader* config, OrbOptions* orb) {
  config->Read("orb.num_features", &orb->num_features, {100, 20000});
  config->Read("orb.levels", &orb->pyramid.levels, {1, 16});
  config->Read("orb.scale_factor", &orb->pyramid.factor, {1.01, 2});
  config->Read("orb.fast_threshold", &orb->fast_threshold, {1, 255});
  config->Read("orb.min_fast_threshold", &orb->min_fast_threshold, {1, 255});
  config->Read("orb.subpixel", &orb->subpixel);
  config->Read("orb.threads", &orb->threads, {1, 64});
}

void ReadTracker(ConfigReader* config, TrackerOptions* tracker) {
  config->Read("tracker.min_tracked_points", &tracker->min_tracked_points, {4, 1000});
  config->Read("tracker.min_tracked_quality", &tracker->min_tracked_quality, {0, 0.99});
  config->Read("tracker.max_lost_frames", &tracker->max_lost_frames, {1, 1000});
  config->Read("tracker.max_map_keyframes", &tracker->max_map_keyframes, {0, 1'000'000});
  config->Read("tracker.localization_only", &tracker->localization_only);
  config->Read("tracker.use_esm", &tracker->use_esm);
  config->Read("tracker.decaying_velocity", &tracker->decaying_velocity);
  int64_t seed = static_cast<int64_t>(tracker->seed);
  config->Read("tracker.seed", &seed, {0, INT64_MAX});
  tracker->seed = static_cast<uint64_t>(seed);
  MapTrackingOptions& map = tracker->map_tracking;
  config->Read("tracker.map_tracking.coarse_radius_px", &map.coarse_radius_px, {1, 500});
  config->Read("tracker.map_tracking.wide_radius_px", &map.wide_radius_px, {1, 500});
  config->Read("tracker.map_tracking.fine_radius_px", &map.fine_radius_px, {0.5, 100});
  config->Read("tracker.map_tracking.fine_wide_radius_px", &map.fine_wide_radius_px, {0.5, 100});
  config->Read("tracker.map_tracking.min_coarse_share", &map.min_coarse_share, {0, 1});
  config->Read("tracker.map_tracking.min_points", &map.min_points, {4, 1000});
  config->Read("tracker.map_tracking.min_coarse_inliers", &map.min_coarse_inliers, {4, 1000});
  config->Read("tracker.map_tracking.max_distance", &map.max_distance, {0, 256});
  config->Read("tracker.map_tracking.max_local_keyframes", &map.max_local_keyframes, {2, 1000});
  KeyFramePolicyOptions& keyframe = tracker->keyframe;
  config->Read("tracker.keyframe.min_points", &keyframe.min_points, {4, 1000});
  config->Read("tracker.keyframe.young_min_points", &keyframe.young_min_points, {4, 1000});
  config->Read("tracker.keyframe.young_keyframes", &keyframe.young_keyframes, {0, 1000});
  config->Read("tracker.keyframe.min_quality", &keyframe.min_quality, {0, 0.99});
  config->Read("tracker.keyframe.sure_points", &keyframe.sure_points, {4, 20000});
  config->Read("tracker.keyframe.max_reference_overlap", &keyframe.max_reference_overlap, {0, 1});
  config->Read("tracker.keyframe.known_place_overlap", &keyframe.known_place_overlap, {0, 1});
  config->Read("tracker.keyframe.recent_keyframes", &keyframe.recent_keyframes, {1, 100000});
  config->Read("tracker.keyframe.urgent_reference_overlap", &keyframe.urgent_reference_overlap, {0, 1});
  config->Read("tracker.keyframe.few_points", &keyframe.few_points, {0, 20000});
  config->Read("tracker.keyframe.urgent_distance_factor", &keyframe.urgent_distance_factor, {0.01, 100});
  config->Read("tracker.keyframe.min_interval_s", &keyframe.min_interval_s, {0, 60});
  config->Read("tracker.keyframe.distance_factor", &keyframe.distance_factor, {0.01, 100});
  config->Read("tracker.keyframe.gap_distance_factor", &keyframe.gap_distance_factor, {0.01, 100});
  InitializerOptions& initializer = tracker->initializer;
  config->Read("tracker.initializer.min_features", &initializer.min_features, {8, 20000});
  config->Read("tracker.initializer.min_matches", &initializer.min_matches, {8, 20000});
  config->Read("tracker.initializer.min_baseline_px", &initializer.min_baseline_px, {0.1, 1000});
  config->Read("tracker.initializer.search_radius_px", &initializer.search_radius_px, {1, 1000});
  RelocalizerOptions& relocalizer = tracker->relocalizer;
  config->Read("tracker.relocalizer.max_candidates", &relocalizer.max_candidates, {1, 100});
  config->Read("tracker.relocalizer.min_matches", &relocalizer.min_matches, {4, 1000});
  config->Read("tracker.relocalizer.min_inliers", &relocalizer.min_inliers, {4, 1000});
}

}  // namespace

Status ReadTrackerOptions(ConfigReader* config, TrackerOptions* options) {
  ReadOrb(config, &options->orb);
  ReadTracker(config, options);
  return options->Check();
}

}  // namespace portolan
