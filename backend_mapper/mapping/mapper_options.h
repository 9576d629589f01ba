#pragma once

#include "base/result.h"
#include "geometry/two_view.h"
#include "map_optimization/landmark_fusion.h"

namespace portolan {

/// Map initialisation (paper Sec. 4.1).
struct InitializationOptions {
  TwoViewOptions two_view;
  int min_points = 50;         ///< points that survive BA; with fewer the tracker would lose the new map at once
  double chi2 = 5.991;         ///< squared normalised error of an outlier after BA
  int bundle_iterations = 15;  ///< of each of the two BA runs; two views converge in about ten
};

/// New points from epipolar search (paper Sec. 4.2).
struct PointCreationOptions {
  int neighbours = 10;         ///< second views tried, best covisible first. The paper takes the closest keyframe alone
  int min_neighbours = 3;      ///< done even when another keyframe waits
  double min_baseline = 0.01;  ///< of a second view, in its median depths: below it depth is noise
  int max_distance = 50;       ///< Hamming, of 256 bits: two views of one corner differ by less, strangers by 128 +- 20
  double epipolar_chi2 = 3.841;      ///< squared normalised distance to the line: 95 %, 1 degree of freedom
  double reprojection_chi2 = 5.991;  ///< squared normalised reprojection error: 95 %, 2 degrees of freedom
  double max_parallax_cos = 0.9998;  ///< rays closer than 1.15 degrees give no depth
  /// Of distance ratio to octave ratio, either way: 1.5 for slant, times one octave (1.2).
  double max_scale_ratio = 1.8;
  double min_depth = 0.1;  ///< nearest new point, in the keyframe's median depths: bounds the search along the line
  double epipole_radius_px = 10;  ///< at octave 0: around the epipole the line's direction is noise
};

/// Fusion of duplicates (paper Sec. 4.2, "new measurements").
struct FusionOptions : LandmarkFusionOptions {
  int neighbours = 10;        ///< covisible keyframes, best first
  int second_neighbours = 3;  ///< of each neighbour
  int max_keyframes = 20;     ///< both kinds together: bounds the work
};

/// Local BA (paper Sec. 4.2).
struct LocalBundleOptions {
  int max_keyframes = 20;  ///< free keyframes, best covisible first; bounds the time
  int max_fixed = 25;      ///< keyframes that hold the window in place, most shared points first
  int min_common = 15;     ///< points that a keyframe of the window shares with the newest
  int iterations = 5;      ///< at most; the window was optimised with the last keyframe already
  double chi2 = 5.991;     ///< squared normalised error of an outlier
};

/// Finding the radial distortion that the calibration left (beyond the paper).
struct LensRefinementOptions {
  bool enabled = true;
  int first_keyframes = 30;  ///< size of a new map when it is looked for first,
  double growth = 1.25;      ///< again whenever the map has grown by this factor,
  int max_keyframes = 300;   ///< and up to this size
  int window = 60;           ///< newest keyframes that take part; with max_points they bound the time to some 0.2 s
  int min_observations = 3;  ///< of a point that takes part
  int min_points = 200;      ///< fewer: not looked for
  int max_points = 500;      ///< of the longest tracks
  int max_iterations = 12;
  /// From the newest keyframe to the one that is turned farthest from it. Straight ahead a radial distortion can't be
  /// told from structure that bends with it (Wu, CVPR 2014, "Critical configurations for radial distortion
  /// self-calibration"). Measured: 28 and more where estimates agree with later ones; 0 to 1 where 4.5 px were taken in
  /// on town_lap, whose calibration is exact, with evidence of 84 (the map ended 80 m off).
  double min_turn_deg = 10;
  double min_shift_px = 0.5;  ///< at the rim; less does no harm
  /// Drop of the error in units of the features' variance. Measured: up to 29 for exact calibrations and for camera
  /// paths that don't tell (straight ones, whose estimates are off by a factor of two), 48 to 375 where estimates agree
  /// with later ones. It holds for an estimate that replaces one, too: of two on kitti_00, 0.1 px and 1 px (a straight
  /// stretch, the ATE 0.8 m in place of 0.3 m) off the best, the evidence was 32 and 34.
  double min_evidence = 40;
  /// Standard deviation of the shift at the rim, as the evidence tells it: shift / sqrt(evidence). As much as may be
  /// left without harm. Measured: up to 0.33 where estimates agree with later ones; 0.74 and 1.2 (town_lap, whose
  /// calibration is exact: 8 px were taken in, and the map bent) on straight ways.
  double max_sigma_px = 0.5;
  /// The drop over that by another focal length in its place. Measured: 1.3 on kitti_00 and above where the lens is
  /// bent for certain; 0.7 and about 1 on kitchen, whose focal length is not sure and whose ATE rises by a third with
  /// such a residual.
  double min_over_focal = 1.15;
};

/// What leaves the map again (paper Sec. 4.2, pruning).
struct PruningOptions {
  int probation_keyframes = 3;     ///< keyframes after its creation in which a new point must prove itself
  int probation_observations = 3;  ///< keyframes that must see it then
  int unreliable_visible = 10;  ///< a point with two measurements goes when predicted visible in more keyframes (paper)
  double redundant_share = 0.9;  ///< of a keyframe's points, seen in at least redundant_observers others (paper)
  int redundant_observers = 3;   ///< (paper)
  int keep_newest = 3;           ///< keyframes that are never pruned: the tracker hangs on them
  int max_checked = 20;          ///< covisible keyframes checked for each new one: bounds the work
};

/// All of the mapper's parameters.
struct MapperOptions {
  int min_landmarks = 10;  ///< a keyframe with fewer tracked landmarks is refused (paper Sec. 3.3: poor below 10)
  InitializationOptions initialization;
  PointCreationOptions creation;
  FusionOptions fusion;
  LocalBundleOptions bundle;
  LensRefinementOptions lens;
  PruningOptions pruning;

  /// Ranges of each field; the message names the field, its value and what was expected.
  Status Check() const;
};

}  // namespace portolan
