#pragma once

#include <cstdint>
#include <vector>

#include "features/feature_matcher.h"
#include "geometry/sim3.h"
#include "optimization/sim3_optimization.h"
#include "place_recognition/landmark_search.h"
#include "place_recognition/neighbourhood.h"

namespace portolan {

/// A landmark of the query's side and one of the candidate's side that look like one.
struct LandmarkPair {
  uint32_t feature = 0;  ///< of the query keyframe, which shows `query`
  const MapPoint* query = nullptr;
  const MapPoint* candidate = nullptr;
  int distance = 0;  ///< Hamming
};

/// Features of the query keyframe against those of the candidate and of its best neighbours in the same vocabulary
/// nodes; each feature keeps its nearest match over all of them, each landmark its nearest feature. Features that show
/// no landmark, or one that both sides see, are passed over.
/// @param keyframes of the candidate's side that are matched, the candidate among them.
std::vector<LandmarkPair> MatchByWords(const Neighbourhood& query, const Neighbourhood& candidate, size_t keyframes,
                                       const MatcherOptions& options);

/// Pairs of landmarks where the similarity puts them: the candidate side's landmarks in the query keyframe, the query
/// keyframe's in the candidate.
/// @param candidate_landmarks of the candidate's side.
std::vector<LandmarkPair> MatchByProjection(const Neighbourhood& query, const Neighbourhood& candidate,
                                            const std::vector<const MapPoint*>& candidate_landmarks,
                                            const Sim3d& query_map_from_candidate_map,
                                            const LandmarkSearchOptions& options);

/// The pairs as measurements between the two keyframes' camera frames, a the candidate's and b the query's. Two views
/// of each landmark on its side: the first keyframe that sees it (the candidate or the query itself, if they do), and
/// of the others that farthest from it, for the scale. Points into the keyframes of both sides.
std::vector<Sim3Match> ToSim3Matches(const std::vector<LandmarkPair>& pairs, const Neighbourhood& query,
                                     const Neighbourhood& candidate);

}  // namespace portolan
