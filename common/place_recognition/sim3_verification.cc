#include "place_recognition/sim3_verification.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <unordered_set>

#include "base/time.h"
#include "place_recognition/place_matching.h"

namespace portolan {
namespace {

double MedianError(const std::vector<FoundLandmark>& found) {
  std::vector<double> errors;
  for (const FoundLandmark& landmark : found) errors.push_back(landmark.error_px);
  return errors.empty() ? 0 : Quantile(std::move(errors), 0.5);
}

double Ratio(double part, double whole) {
  return whole > 0 ? part / whole : 0;
}

/// The steps, one after another; each may end it with a reason.
class Verification {
 public:
  Verification(const Map& query_map, KeyFrameId query, const Map& candidate_map, KeyFrameId candidate,
               const Sim3VerificationOptions& options)
      : options_(options),
        query_(query_map, query, options.neighbourhood),
        candidate_(candidate_map, candidate, options.neighbourhood) {}

  Status MatchWords() {
    pairs_ = MatchByWords(query_, candidate_, options_.word_keyframes, options_.words);
    evidence().word_matches = static_cast<int>(pairs_.size());
    if (evidence().word_matches >= options_.min_word_matches) return Ok{};
    return Error{fmt::format("{} landmarks matched by words, expected {}", pairs_.size(), options_.min_word_matches)};
  }

  Status EstimateByRansac() {
    Sim3RansacOptions ransac = options_.ransac;
    ransac.fix_scale = options_.fix_scale;
    const auto estimate = EstimateSim3(ToSim3Matches(pairs_, query_, candidate_), ransac);
    if (!estimate) return estimate.error();
    place_.query_from_candidate = estimate->b_from_a;
    evidence().ransac_inliers = estimate->num_inliers;
    return Ok{};
  }

  Status RefineGuided() {
    query_landmarks_ = query_.Landmarks(candidate_);
    candidate_landmarks_ = candidate_.Landmarks(query_);
    pairs_ = MatchByProjection(query_, candidate_, candidate_landmarks_, QueryMapFromCandidateMap(), options_.guided);
    Sim3OptimizationOptions refinement;
    refinement.fix_scale = options_.fix_scale;
    const Sim3OptimizationResult refined =
        OptimizeSim3(ToSim3Matches(pairs_, query_, candidate_), place_.query_from_candidate, refinement);
    place_.query_from_candidate = refined.b_from_a;
    place_.inliers = evidence().inliers = refined.num_inliers;
    for (size_t i = 0; i < pairs_.size(); ++i) {
      if (!refined.inliers[i]) continue;
      place_.matches.emplace_back(pairs_[i].query->id, pairs_[i].candidate->id);
      place_.seen.emplace_back(pairs_[i].feature, pairs_[i].candidate->id);
    }
    if (refined.num_inliers >= options_.min_inliers) return Ok{};
    return Error{fmt::format("{} inliers of {} after refinement, expected {}", refined.num_inliers, pairs_.size(),
                             options_.min_inliers)};
  }

  /// The candidate side's landmarks in the query, the query side's in the candidate.
  Status SearchWide() {
    const Sim3d query_map_from_candidate_map = QueryMapFromCandidateMap();
    const Rigid3d query_from_query_map = query_.keyframe().camera_from_map;
    const Rigid3d candidate_from_candidate_map = candidate_.keyframe().camera_from_map;
    const LandmarkSearchResult in_query =
        Find(candidate_landmarks_, TransformPose(query_from_query_map, query_map_from_candidate_map.Inverse()), query_);
    const LandmarkSearchResult in_candidate =
        Find(query_landmarks_, TransformPose(candidate_from_candidate_map, query_map_from_candidate_map), candidate_);
    const LandmarkSearchResult own_in_query = Find(query_landmarks_, query_from_query_map, query_);
    const LandmarkSearchResult own_in_candidate = Find(candidate_landmarks_, candidate_from_candidate_map, candidate_);
    candidate_own_share_ = own_in_candidate.expected.Share();
    const double query_own_share = own_in_query.expected.Share();
    PlaceEvidence& e = evidence();
    e.in_query = in_query.expected;
    e.in_candidate = in_candidate.expected;
    e.share =
        std::sqrt(Ratio(e.in_query.Share(), candidate_own_share_) * Ratio(e.in_candidate.Share(), query_own_share));
    e.cells = std::sqrt(in_query.ShareOfCells(options_.cell_share * candidate_own_share_) *
                        in_candidate.ShareOfCells(options_.cell_share * query_own_share));
    e.spread = in_query.Spread(*query_.keyframe().data);
    e.median_error_px = MedianError(in_query.found);
    place_.group_inliers = static_cast<int>(in_query.found.size());
    AddSeen(in_query.found);
    return CheckWide();
  }

  /// A look-alike seldom goes on where the query's neighbours look.
  Status AskNeighbours() {
    const Sim3d candidate_map_from_query_map = QueryMapFromCandidateMap().Inverse();
    PlaceEvidence& e = evidence();
    for (size_t k = 1; k < query_.keyframes().size() && k <= options_.consistency_keyframes; ++k) {
      const KeyFrame& neighbour = *query_.keyframes()[k];
      const LandmarkSearchResult found =
          FindLandmarks(candidate_landmarks_, TransformPose(neighbour.camera_from_map, candidate_map_from_query_map),
                        *neighbour.data, options_.wide);
      if (found.expected.expected < options_.min_expected) continue;
      ++e.asked;
      e.shares_asked.push_back(Ratio(found.expected.Share(), candidate_own_share_));
      if (e.shares_asked.back() >= options_.min_neighbour_share) ++e.agreeing;
    }
    if (e.agreeing >= options_.min_agreeing) return Ok{};
    return Error{
        fmt::format("{} of {} covisible keyframes agree, expected {}", e.agreeing, e.asked, options_.min_agreeing)};
  }

  const VerifiedPlace& place() const { return place_; }

 private:
  PlaceEvidence& evidence() { return place_.evidence; }

  Sim3d QueryMapFromCandidateMap() const {
    return Sim3d(query_.keyframe().camera_from_map.Inverse()) * place_.query_from_candidate *
           Sim3d(candidate_.keyframe().camera_from_map);
  }

  LandmarkSearchResult Find(const std::vector<const MapPoint*>& landmarks, const Rigid3d& camera_from_map,
                            const Neighbourhood& in) const {
    return FindLandmarks(landmarks, camera_from_map, *in.keyframe().data, options_.wide);
  }

  Status CheckWide() const {
    const PlaceEvidence& e = place_.evidence;
    const std::string counts = fmt::format("{} of {}, back {} of {}", e.in_query.found, e.in_query.expected,
                                           e.in_candidate.found, e.in_candidate.expected);
    if (place_.group_inliers < options_.min_group_inliers) {
      return Error{fmt::format("{} landmarks around the candidate found, expected {}", place_.group_inliers,
                               options_.min_group_inliers)};
    }
    if (std::min(e.in_query.expected, e.in_candidate.expected) < options_.min_expected)
      return Error{
          fmt::format("too few landmarks in view to judge by ({}), expected {}", counts, options_.min_expected)};
    if (e.share < options_.min_share) {
      return Error{fmt::format("{:.0f} % of what should be in view found ({}), expected {:.0f} %", 100 * e.share,
                               counts, 100 * options_.min_share)};
    }
    if (e.spread < options_.min_spread)
      return Error{
          fmt::format("found in {:.0f} % of the image, expected {:.0f} %", 100 * e.spread, 100 * options_.min_spread)};
    if (e.Weight() < options_.min_weight) {
      return Error{fmt::format(
          "weight {:.1f}, expected {:.0f}: {:.0f} % of what should be in view found ({}), in {:.0f} % of the cells "
          "where "
          "it should be, in {:.0f} % of the image; {} inliers",
          e.Weight(), options_.min_weight, 100 * e.share, counts, 100 * e.cells, 100 * e.spread, e.inliers)};
    }
    return Ok{};
  }

  void AddSeen(const std::vector<FoundLandmark>& found) {
    std::unordered_set<uint32_t> features;
    std::unordered_set<MapPointId> landmarks;
    for (const auto& [feature, landmark] : place_.seen) {
      features.insert(feature);
      landmarks.insert(landmark);
    }
    for (const FoundLandmark& f : found) {
      const MapPointId id = candidate_landmarks_[f.landmark]->id;
      if (features.count(f.feature) == 1 || landmarks.count(id) == 1) continue;
      place_.seen.emplace_back(f.feature, id);
    }
  }

  const Sim3VerificationOptions& options_;
  Neighbourhood query_, candidate_;
  std::vector<const MapPoint*> query_landmarks_, candidate_landmarks_;  // of each side, but for those that both see
  double candidate_own_share_ = 0;  // of its side's landmarks that should be found, those that the candidate finds
  std::vector<LandmarkPair> pairs_;
  VerifiedPlace place_;
};

}  // namespace

double PlaceEvidence::Weight() const {
  return std::sqrt(static_cast<double>(in_query.found) * in_candidate.found) * share * cells * spread;
}

std::string ToString(const PlaceEvidence& e) {
  std::string asked;
  for (const double share : e.shares_asked) asked += fmt::format(" {:.0f}", 100 * share);
  return fmt::format(
      "{} by words, RANSAC {}, {} inliers, found {} of {} and back {} of {}: {:.0f} %, in {:.0f} % of the cells, in "
      "{:.0f} % of the image: "
      "weight {:.1f}; error {:.1f} px, {} of {} keyframes agree ({} %)",
      e.word_matches, e.ransac_inliers, e.inliers, e.in_query.found, e.in_query.expected, e.in_candidate.found,
      e.in_candidate.expected, 100 * e.share, 100 * e.cells, 100 * e.spread, e.Weight(), e.median_error_px, e.agreeing,
      e.asked, asked.empty() ? "none" : asked.substr(1));
}

Result<VerifiedPlace> VerifyPlace(const Map& query_map, KeyFrameId query, const Map& candidate_map,
                                  KeyFrameId candidate, const Sim3VerificationOptions& options,
                                  const std::atomic<bool>* stop, StageTimes* times) {
  Stopwatch watch;
  const auto note = [&](const char* step) {
    if (times != nullptr) times->Add(step, watch.Milliseconds());
    watch.Restart();
  };
  Verification verification(query_map, query, candidate_map, candidate, options);
  using Step = Status (Verification::*)();
  constexpr std::pair<const char*, Step> kSteps[] = {{"verify_words", &Verification::MatchWords},
                                                     {"verify_ransac", &Verification::EstimateByRansac},
                                                     {"verify_refine", &Verification::RefineGuided},
                                                     {"verify_wide", &Verification::SearchWide},
                                                     {"verify_neighbours", &Verification::AskNeighbours}};
  for (const auto& [name, step] : kSteps) {
    if (stop != nullptr && *stop) return Error{"stopped"};
    const Status status = (verification.*step)();
    note(name);
    if (!status) return status.error();
  }
  return verification.place();
}

}  // namespace portolan
