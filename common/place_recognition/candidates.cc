#include "place_recognition/candidates.h"

#include <algorithm>
#include <map>

namespace portolan {
namespace {

/// Bag similarity of all keyframes that share enough words with the query.
std::map<KeyFrameId, double> ScoreKeyFrames(const std::vector<SharedWords>& shared, const CandidateOptions& options,
                                            const std::function<bool(KeyFrameId)>& exclude) {
  std::map<KeyFrameId, double> scores;
  double min_words = 0;
  for (const SharedWords& s : shared) {  // most words first: what comes after the last that counts is not looked at
    if (s.words < min_words || (options.most_scored > 0 && scores.size() == options.most_scored)) break;
    if (exclude && exclude(s.keyframe)) continue;
    if (scores.empty()) min_words = options.min_shared_words * s.words;
    scores.emplace(s.keyframe, s.score);
  }
  return scores;
}

}  // namespace

std::vector<Candidate> FindCandidates(const BowVector& bow, const KeyFrameIndex& index, const Map& map,
                                      const CandidateOptions& options, const std::function<bool(KeyFrameId)>& exclude) {
  return FindCandidates(index.Query(bow), map, options, exclude);
}

std::vector<Candidate> FindCandidates(const std::vector<SharedWords>& shared, const Map& map,
                                      const CandidateOptions& options, const std::function<bool(KeyFrameId)>& exclude) {
  return FindCandidates(shared, NeighboursIn(map), options,
                        [&](KeyFrameId id) { return map.FindKeyFrame(id) == nullptr || (exclude && exclude(id)); });
}

NeighboursOf NeighboursIn(const Map& map) {
  return [&map](KeyFrameId keyframe, size_t most) -> std::optional<std::vector<KeyFrameId>> {
    if (map.FindKeyFrame(keyframe) == nullptr) return std::nullopt;
    std::vector<KeyFrameId> neighbours;
    for (const auto& [id, common] : map.CovisibleKeyFrames(keyframe, 1, most)) neighbours.push_back(id);
    return neighbours;
  };
}

std::vector<Candidate> FindCandidates(const std::vector<SharedWords>& shared, const NeighboursOf& neighbours,
                                      const CandidateOptions& options, const std::function<bool(KeyFrameId)>& exclude) {
  const std::map<KeyFrameId, double> scores = ScoreKeyFrames(shared, options, exclude);
  std::map<KeyFrameId, Candidate> best_of_group;
  double best_accumulated = 0;
  for (const auto& [id, score] : scores) {
    Candidate group{id, score, score};
    const auto around = neighbours(id, options.neighbours);
    if (!around) continue;
    for (const KeyFrameId neighbour : *around) {
      const auto found = scores.find(neighbour);
      if (found == scores.end()) continue;
      group.accumulated_score += found->second;
      if (found->second > group.score) {
        group.keyframe = neighbour;
        group.score = found->second;
      }
    }
    best_accumulated = std::max(best_accumulated, group.accumulated_score);
    Candidate& kept = best_of_group[group.keyframe];
    if (kept.accumulated_score < group.accumulated_score) kept = group;
  }
  std::vector<Candidate> candidates;
  for (const auto& [id, candidate] : best_of_group) {
    if (candidate.accumulated_score > options.min_score * best_accumulated) candidates.push_back(candidate);
  }
  std::stable_sort(candidates.begin(), candidates.end(),
                   [](const Candidate& a, const Candidate& b) { return a.accumulated_score > b.accumulated_score; });
  if (candidates.size() > options.most) candidates.resize(options.most);
  return candidates;
}

}  // namespace portolan
