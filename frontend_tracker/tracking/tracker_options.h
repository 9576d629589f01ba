#pragma once

#include "base/result.h"
#include "features/orb_extractor.h"
#include "map/map.h"

namespace portolan {

/// Coarse-to-fine tracking in the map (paper Sec. 3.2).
struct MapTrackingOptions {
  double coarse_radius_px = 15.0;  ///< search window of the first stage, at level 0; grows with the feature's level
  double wide_radius_px = 45.0;    ///< when the first stage finds no more than by chance
  /// Of the reference's landmarks; with fewer found, other predictions are tried too.
  double min_coarse_share = 0.5;
  double fine_radius_px = 4.0;        ///< second stage, when the first had enough inliers
  double fine_wide_radius_px = 10.0;  ///< second stage, when it had not
  int min_points = 10;                ///< first stage: fewer, and the prediction failed
  int min_coarse_inliers = 20;        ///< enough for the narrow second stage
  /// Hamming, of 256 bits: frames follow each other closely, geometry vouches for the rest.
  int max_distance = 100;
  double ratio = 0.8;            ///< best over second best of the same level, second stage
  double min_view_cosine = 0.5;  ///< a landmark seen from more than 60 degrees off its mean direction is left out
  int max_local_keyframes = 60;  ///< bounds the local map, and with it the time for a frame
};

/// When a frame becomes a keyframe (paper Sec. 3.3).
struct KeyFramePolicyOptions {
  /// Fewer tracked points: quality is poor (paper, there 10). Past a bare wall some thirty, seen in one corner, fit a
  /// wrong pose as well as the right one, and what is made from there has another scale: office_walk with 10 and the
  /// middle of halls' pictures, jumps by 2. With 70 maps fall apart that hold.
  int min_points = 50;
  /// In a map that has just begun: the paper's. It may have no more than fifty landmarks, which a frame or two later
  /// are not all in sight, and has no scale yet that could be lost.
  int young_min_points = 10;
  /// With fewer a map is young. Not tuned: town_lap's small maps had 62 to 99 points at their start, and died of fifty.
  int young_keyframes = 10;
  int MinPoints(const Map& map) const {
    return map.keyframes().size() < static_cast<size_t>(young_keyframes) ? young_min_points : min_points;
  }
  double min_quality = 0.7;  ///< s = n / m above it: quality is good (paper)
  /// Beyond the paper: with this many inliers the pose is good whatever their share. Where texture repeats many matches
  /// are wrong, and without new keyframes tracking would starve. With 100, where less than half agree, maps of
  /// office_walk bend in fast turns (backwards 1.3 m in place of 0.12 m); with 140 it is lost in them more often.
  int sure_points = 120;
  /// Beyond the paper: share of the reference keyframe's established landmarks still tracked, below which the view has
  /// changed enough even without translation (rotation into the unseen).
  double max_reference_overlap = 0.9;
  /// The same where the reference is older than recent_keyframes: a place that has been mapped. What is not tracked
  /// there of all that was ever seen is no news, and mapping it again would let maps grow with every lap.
  double known_place_overlap = 0.6;
  int recent_keyframes = 30;              ///< of this tracker, the youngest: where it is mapping
  double urgent_reference_overlap = 0.6;  ///< below this share the frame is urgent: a busy mapper is interrupted for it
  /// With fewer inliers than this, and a new view, it is too: some frames more and the camera would be lost. New
  /// landmarks count then: with less than urgent_reference_overlap of all that the reference sees the view is new.
  int few_points = 120;
  /// From this factor on (the paper's Eq. 7) too. What is less urgent waits for an idle mapper: a BA that is
  /// interrupted for every frame never gets anywhere.
  double urgent_distance_factor = 1.0;
  double min_interval_s = 0.0;  ///< at least this long after the last keyframe
  /// Scales the right side of Eq. (7). Half the paper's: the mapper has time for the keyframes, and scale drifts less
  /// with them (kitti_00 in lockstep: 1.8 m instead of 2.3 m).
  double distance_factor = 0.5;
  /// The same for frames between a map's first two keyframes, which are 1 apart. With 0.1 blackout begins still better,
  /// but office_walk, where everything hangs on its fast turns, bends in one of them in half of the runs.
  double gap_distance_factor = 0.2;
};

/// Choosing the two frames of a new map (paper Sec. 4.1).
struct InitializerOptions {
  int min_features = 150;         ///< in a frame, to be the first
  int min_matches = 100;          ///< with the first frame, below it the first frame is set anew
  double min_baseline_px = 20.0;  ///< median image motion after compensation of the rotation (paper Eq. 8)
  /// For shorter focal lengths the baseline shrinks in proportion, so that it stays an angle.
  double reference_focal_px = 500.0;
  /// Half the image's diagonal in focal lengths. With a narrower view the baseline shrinks in proportion: a scene would
  /// have left the picture before. All sequences of the data folder are above it (0.65 and more), and stay as they
  /// were; the middle of kitchen's pictures has 0.41.
  double reference_half_view = 0.6;
  double search_radius_px = 60.0;  ///< around the predicted location
  int max_frames = 90;             ///< after so many the first frame is set anew
};

struct RelocalizerOptions {
  int max_candidates = 5;
  int min_matches = 15;  ///< by bag of words, to try EPnP
  /// After the second stage, to believe it: more than for tracking, as no motion model vouches for it.
  int min_inliers = 30;
};

struct TrackerOptions {
  OrbOptions orb;
  MapTrackingOptions map_tracking;
  KeyFramePolicyOptions keyframe;
  InitializerOptions initializer;
  RelocalizerOptions relocalizer;
  /// Inliers of a frame that counts as tracked. Keyframes from poses by 22 to 26 bent office_walk's map in fast turns:
  /// what they see first gets another scale, 4 to 7 times off. To be lost for some frames costs less.
  int min_tracked_points = 30;
  /// The same: s = n / m, unless there are keyframe.sure_points. In windows of the fine stage a wrong pose finds 0.1 to
  /// 0.25 by chance; from 0.3 to 0.5 on office_walk poses are off by a degree a frame, and maps bend by and by.
  double min_tracked_quality = 0.5;
  int max_lost_frames = 5;  ///< "more than five frames" that can't be tracked: lost (paper Sec. 3.4)
  /// A map with so many is full: where it ends a new one begins (paper Sec. 3.4); 0: unlimited.
  int max_map_keyframes = 0;
  bool localization_only = false;  ///< changes no map: neither keyframes nor new maps
  bool use_esm = true;             ///< rotation from ESM (Eq. 3-6); off: from the velocity model
  /// The velocity model of Eq. (1); off: constant velocity, that between the last two poses. For comparisons (paper
  /// Table 2).
  bool decaying_velocity = true;
  uint64_t seed = 1;

  /// Ranges of every field; the message names the key.
  Status Check() const;
};

}  // namespace portolan
