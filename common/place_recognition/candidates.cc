#include "place_recognition/candidates.h"

#include <algorithm>
#include <map>

namespace portolan {
namespace {

/// Bag similarity of all keyframes that share enough words with the query.
std::map<KeyFrameId, double> ScoreKeyFrames(const BowVector& bow, const KeyFrameIndex& index, const Map& map, const CandidateOptions& options,
                                            const std::function<bool(KeyFrameId)>& exclude) {
  std::vector<SharedWords> shared = index.Query(bow);
  shared.erase(std::remove_if(shared.begin(), shared.end(),
                              [&](const SharedWords& s) {
                                return map.FindKeyFrame(s.keyframe) == nullptr || (exclude && exclude(s.keyframe));
                              }),
               shared.end());
  std::map<KeyFrameId, double> scores;
  if (shared.empty()) return scores;
  const double min_words = options.min_shared_words * shared.front().words;
  for (const SharedWords& s : shared) {
    if (options.most_scored > 0 && scores.size() == options.most_scored) break;
    if (s.words >= min_words) scores[s.keyframe] = s.score;
  }
  return scores;
}

}  // namespace

std::vector<Candidate> FindCandidates(const BowVector& bow, const KeyFrameIndex& index, const Map& map, const CandidateOptions& options,
                                      const std::function<bool(KeyFrameId)>& exclude) {
  const std::map<KeyFrameId, double> scores = ScoreKeyFrames(bow, index, map, options, exclude);
  std::map<KeyFrameId, Candidate> best_of_group;
  double best_accumulated = 0;
  for (const auto& [id, score] : scores) {
    Candidate group{id, score, score};
    for (const auto& [neighbour, common] : map.CovisibleKeyFrames(id, 1, options.neighbours)) {
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
