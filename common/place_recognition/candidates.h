#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "map/map.h"
#include "vocabulary/keyframe_index.h"

namespace portolan {

struct CandidateOptions {
  double min_shared_words = 0.5;  ///< of the most words that any keyframe shares with the query
  double min_score = 0.75;        ///< of the best accumulated score (paper Sec. 5)
  size_t neighbours = 10;         ///< covisible keyframes over which scores are accumulated
  size_t most = 10;               ///< candidates returned
  /// Keyframes with the most shared words whose scores are accumulated: bounds the time (0: all).
  size_t most_scored = 0;
};

struct Candidate {
  KeyFrameId keyframe;
  double score = 0;              ///< similarity of the bags, 0 to 1
  double accumulated_score = 0;  ///< with those of its covisible keyframes
};

/// Keyframes of `map` that may show what `bow` shows (paper Sec. 3.1 and 5): scored by shared words, accumulated over
/// covisible keyframes, those above 75 % of the best; of each group its best keyframe, once. Best first. `exclude` (may
/// be null) leaves keyframes out.
std::vector<Candidate> FindCandidates(const BowVector& bow, const KeyFrameIndex& index, const Map& map,
                                      const CandidateOptions& options, const std::function<bool(KeyFrameId)>& exclude);
/// The same for what an index has found already (KeyFrameIndex::Query).
std::vector<Candidate> FindCandidates(const std::vector<SharedWords>& shared, const Map& map,
                                      const CandidateOptions& options, const std::function<bool(KeyFrameId)>& exclude);

/// Covisible keyframes of one, those with most common points first, `most` at most; none if it is not in the map.
using NeighboursOf = std::function<std::optional<std::vector<KeyFrameId>>(KeyFrameId keyframe, size_t most)>;
/// As the map has them, which must outlive what is returned.
NeighboursOf NeighboursIn(const Map& map);
/// The same for a map of which no more is known.
std::vector<Candidate> FindCandidates(const std::vector<SharedWords>& shared, const NeighboursOf& neighbours,
                                      const CandidateOptions& options, const std::function<bool(KeyFrameId)>& exclude);

}  // namespace portolan
