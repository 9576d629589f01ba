#pragma once

#include <atomic>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "base/result.h"
#include "base/statistics.h"
#include "features/feature_matcher.h"
#include "map/map.h"
#include "place_recognition/landmark_search.h"
#include "place_recognition/neighbourhood.h"
#include "place_recognition/sim3_ransac.h"

namespace portolan {

struct Sim3VerificationOptions {
  // Where evidence is looked for.
  NeighbourhoodOptions neighbourhood;   ///< of the query and of the candidate
  size_t word_keyframes = 6;            ///< of the candidate's side matched by words, the candidate among them
  MatcherOptions words{50, 0.8, true};  ///< matches by words
  Sim3RansacOptions ransac;             ///< the seed is here
  LandmarkSearchOptions guided{8, 50};  ///< with the similarity of RANSAC, whose translation is off by some pixels
  LandmarkSearchOptions wide{4, 50};    ///< with the refined one: 3 sigmas and the error of the landmarks
  bool fix_scale = false;               ///< both maps have one scale

  // How much of it is enough. Measured with portolan_place_precision on halls, town_lap and blackout, where walls and
  // whole houses come again, mostly turned by 90 degrees, and on a synthetic town of five house fronts: 1400 wrong
  // similarities reach 116 inliers or shares of 63 %, but a weight of 11.3 at most. Of keyframes with a right one, 61 %
  // (the two halves of kitchen as two maps) to 96 % (town_lap) have one above 17.
  int min_word_matches = 20;         ///< landmarks matched by words: spares RANSAC most wrong candidates
  int min_inliers = 20;              ///< landmark pairs on which the refined similarity agrees
  int min_group_inliers = 40;        ///< landmarks of the candidate's side found in the query keyframe
  int min_expected = 30;             ///< landmarks that should be found, either way: fewer tell no share
  double min_share = 0.25;           ///< see PlaceEvidence
  double min_spread = 0.1;           ///< see PlaceEvidence
  double min_weight = 17;            ///< see PlaceEvidence; half as much again as the best wrong place
  size_t consistency_keyframes = 5;  ///< the query's best covisible keyframes that are asked
  double min_neighbour_share = 0.2;  ///< of what should be found, in each of them
  int min_agreeing = 3;              ///< of them

  /// Of the share over the whole image, what must be found in a cell of it for that cell to agree.
  double cell_share = 0.35;
};

/// What speaks for two keyframes showing one place. All shares are in relation to what a keyframe of the landmarks' own
/// side finds of them: 1 is as good as having been there. "Both ways": the geometric mean of the candidate side's
/// landmarks in the query and the query side's in the candidate.
struct PlaceEvidence {
  int word_matches = 0;        ///< landmark pairs by words
  int ransac_inliers = 0;      ///< of them
  int inliers = 0;             ///< landmark pairs of the refined similarity
  double median_error_px = 0;  ///< of the candidate side's landmarks in the query, pixels of their pyramid levels
  ExpectedLandmarks in_query, in_candidate;  ///< landmarks that should be found in each, were it one place
  double share = 0;   ///< of the landmarks that should be found, both ways: a look-alike lacks what is around it
  double cells = 0;   ///< of the image's cells where landmarks should be found, both ways
  double spread = 0;  ///< share of the query image's cells with a landmark found
  int asked = 0, agreeing = 0;       ///< the query's covisible keyframes which should see enough, and which agree
  std::vector<double> shares_asked;  ///< of each of them

  /// Landmarks found (both ways), discounted by what is missing: in number, by parts of the image, and by the part of
  /// the image that shows any. Tells places from look-alikes better than the inliers or any of the shares alone.
  double Weight() const;
};

/// For logs: all figures in one line.
std::string ToString(const PlaceEvidence& evidence);

/// A place that was seen twice.
struct VerifiedPlace {
  /// Query keyframe's camera frame (its map's units) from candidate keyframe's (its map's).
  Sim3d query_from_candidate;
  std::vector<std::pair<MapPointId, MapPointId>> matches;  ///< inliers: landmark of the query's map, of the candidate's
  /// (feature of the query keyframe, landmark of the candidate's side that it sees); those of the matches are among
  /// them.
  std::vector<std::pair<uint32_t, MapPointId>> seen;
  int inliers = 0;        ///< of the refined similarity
  int group_inliers = 0;  ///< landmarks of the candidate's whole neighbourhood found in the query keyframe
  PlaceEvidence evidence;
};

/// Whether two keyframes, of one map or of two, show one place, and the similarity between them (paper Sec. 5, second
/// step): landmark pairs by words, Horn's closed form in RANSAC (paper Eq. 12), guided search, refinement on both
/// reprojection errors. Then it must stand: found of the landmarks that should be in view, both ways, enough; all over
/// the image; and the same in the query's covisible keyframes. Landmarks that both sides see are no evidence.
/// Fails with the reason in words and numbers. Deterministic for options.ransac.seed.
/// @param stop raised by another thread: fails soon. May be null. @param times by step, milliseconds. May be null.
Result<VerifiedPlace> VerifyPlace(const Map& query_map, KeyFrameId query, const Map& candidate_map,
                                  KeyFrameId candidate, const Sim3VerificationOptions& options,
                                  const std::atomic<bool>* stop = nullptr, StageTimes* times = nullptr);

}  // namespace portolan
