#pragma once

#include <vector>

#include "atlas/overlap_detector.h"

namespace portolan {

struct LocatorOptions {
  LocatorOptions() {
    candidates.most = 3;
    candidates.most_scored = 20;
  }
  CandidateOptions candidates;           ///< of each map
  int max_verified = 5;                  ///< over all maps: bounds the time
  MatcherOptions words{50, 0.75, true};  ///< as the tracker relocalises: nothing else vouches for these matches
  int min_matches = 20;                  ///< landmarks of the candidate and its neighbours found by words
  int min_inliers = 15;                  ///< of them, on which a pose agrees
  size_t word_keyframes = 4;             ///< of the candidate's side matched by words, the candidate among them
  size_t max_looked_up = 20000;          ///< keyframes; a lost tracker waits, but no longer than a moment
};

/// A frame found in a map.
struct LocatedFrame {
  MapId map;
  KeyFrameId keyframe;  ///< that sees the same
  int inliers = 0;
  Rigid3d camera_from_map;
};

/// Finds a frame of a tracker that knows no map in any of the maps (start from a saved atlas, lost trackers):
/// candidates by words over all of them, best score first, then EPnP in RANSAC on landmarks matched by words (paper
/// Sec. 3.1). The one with the most inliers of those verified. Fails with the reason in words and numbers.
/// Deterministic.
/// @param frame with direct index. @param bow its words. @param ensure see OverlapDetector; a candidate whose
/// map or descriptors are not there is passed over.
Result<LocatedFrame> LocateFrame(const KeyFrameData& frame, const BowVector& bow, const std::vector<OtherMap>& maps,
                                 const OverlapDetector::EnsureAppearance& ensure, const LocatorOptions& options,
                                 StageTimes* times);

}  // namespace portolan
