#include "place_recognition/place_matching.h"

#include <algorithm>
#include <unordered_set>
#include <utility>

namespace portolan {
namespace {

/// Keeps of the pairs at one feature, and then of those with one landmark on the candidate's side, the closest (the
/// first of equals); by feature.
std::vector<LandmarkPair> KeepClosest(std::vector<LandmarkPair> pairs) {
  std::stable_sort(pairs.begin(), pairs.end(),
                   [](const LandmarkPair& a, const LandmarkPair& b) { return a.distance < b.distance; });
  std::unordered_set<uint32_t> features;
  std::unordered_set<MapPointId> landmarks;
  std::vector<LandmarkPair> kept;
  for (const LandmarkPair& pair : pairs) {
    if (features.count(pair.feature) == 1 || !landmarks.insert(pair.candidate->id).second) continue;
    features.insert(pair.feature);
    kept.push_back(pair);
  }
  std::sort(kept.begin(), kept.end(),
            [](const LandmarkPair& a, const LandmarkPair& b) { return a.feature < b.feature; });
  return kept;
}

/// A side's cameras in the frame of its keyframe.
struct SideCameras {
  explicit SideCameras(const Neighbourhood& side) : keyframes(side.keyframes()) {
    const Rigid3d map_from_side = side.keyframe().camera_from_map.Inverse();
    for (const KeyFrame* keyframe : keyframes) {
      camera_from_side.push_back(keyframe->camera_from_map * map_from_side);
      centres.push_back(camera_from_side.back().TargetOriginInSource());
    }
  }

  SideView ViewOf(size_t k, uint32_t feature) const {
    const KeyFrameData& data = *keyframes[k]->data;
    return {&data.camera, camera_from_side[k], data.features.pixels_px[feature].cast<double>(),
            data.pyramid.Sigma(data.features.octaves[feature])};
  }

  /// The two views of ToSim3Matches; one if no other keyframe of the side sees the landmark.
  std::vector<SideView> ViewsOf(const MapPoint& point) const {
    const Observation *first = nullptr, *other = nullptr;
    size_t first_k = 0, other_k = 0;
    double farthest = -1;
    for (size_t k = 0; k < keyframes.size(); ++k) {
      const Observation* observation = point.FindObservation(keyframes[k]->data->id);
      if (observation == nullptr) continue;
      if (first == nullptr) {
        first = observation;
        first_k = k;
      } else if (const double distance = (centres[k] - centres[first_k]).norm(); distance > farthest) {
        farthest = distance;
        other = observation;
        other_k = k;
      }
    }
    std::vector<SideView> views;
    if (first != nullptr) views.push_back(ViewOf(first_k, first->feature));
    if (other != nullptr) views.push_back(ViewOf(other_k, other->feature));
    return views;
  }

  const std::vector<const KeyFrame*>& keyframes;
  std::vector<Rigid3d> camera_from_side;
  std::vector<Eigen::Vector3d> centres;
};

}  // namespace

std::vector<LandmarkPair> MatchByWords(const Neighbourhood& query, const Neighbourhood& candidate, size_t keyframes,
                                       const MatcherOptions& options) {
  const KeyFrameData& first = *query.keyframe().data;
  const std::vector<const MapPoint*> of_query = query.LandmarksByFeature(query.keyframe(), candidate);
  std::vector<LandmarkPair> pairs;
  for (size_t k = 0; k < std::min(keyframes, candidate.keyframes().size()); ++k) {
    const KeyFrameData& second = *candidate.keyframes()[k]->data;
    const std::vector<const MapPoint*> of_candidate = candidate.LandmarksByFeature(*candidate.keyframes()[k], query);
    const std::vector<FeatureMatch> matches = MatchByNodes(
        first.features, first.nodes, second.features, second.nodes, options,
        [&](uint32_t i) { return of_query[i] != nullptr; }, [&](uint32_t j) { return of_candidate[j] != nullptr; });
    for (const FeatureMatch& match : matches) {
      pairs.push_back({match.first, of_query[match.first], of_candidate[match.second], match.distance});
    }
  }
  return KeepClosest(std::move(pairs));
}

std::vector<LandmarkPair> MatchByProjection(const Neighbourhood& query, const Neighbourhood& candidate,
                                            const std::vector<const MapPoint*>& candidate_landmarks,
                                            const Sim3d& query_map_from_candidate_map,
                                            const LandmarkSearchOptions& options) {
  const KeyFrame& first = query.keyframe();
  const KeyFrame& second = candidate.keyframe();
  const std::vector<const MapPoint*> of_query = query.LandmarksByFeature(first, candidate);
  const std::vector<const MapPoint*> of_candidate = candidate.LandmarksByFeature(second, query);
  std::vector<LandmarkPair> pairs;
  const Rigid3d query_from_candidate_map = TransformPose(first.camera_from_map, query_map_from_candidate_map.Inverse());
  for (const FoundLandmark& found :
       FindLandmarks(candidate_landmarks, query_from_candidate_map, *first.data, options).found) {
    const MapPoint* at = of_query[found.feature];
    if (at != nullptr) pairs.push_back({found.feature, at, candidate_landmarks[found.landmark], found.distance});
  }
  std::vector<const MapPoint*> searched;
  std::vector<uint32_t> features;
  for (uint32_t i = 0; i < of_query.size(); ++i) {
    if (of_query[i] == nullptr) continue;
    searched.push_back(of_query[i]);
    features.push_back(i);
  }
  const Rigid3d candidate_from_query_map = TransformPose(second.camera_from_map, query_map_from_candidate_map);
  for (const FoundLandmark& found : FindLandmarks(searched, candidate_from_query_map, *second.data, options).found) {
    const MapPoint* at = of_candidate[found.feature];
    if (at != nullptr) pairs.push_back({features[found.landmark], searched[found.landmark], at, found.distance});
  }
  return KeepClosest(std::move(pairs));
}

std::vector<Sim3Match> ToSim3Matches(const std::vector<LandmarkPair>& pairs, const Neighbourhood& query,
                                     const Neighbourhood& candidate) {
  const SideCameras query_cameras(query), candidate_cameras(candidate);
  std::vector<Sim3Match> matches;
  for (const LandmarkPair& pair : pairs) {
    Sim3Match match;
    match.point_in_a = candidate.keyframe().camera_from_map * pair.candidate->position_in_map.cast<double>();
    match.point_in_b = query.keyframe().camera_from_map * pair.query->position_in_map.cast<double>();
    match.views_in_a = candidate_cameras.ViewsOf(*pair.candidate);
    match.views_in_b = query_cameras.ViewsOf(*pair.query);
    matches.push_back(std::move(match));
  }
  return matches;
}

}  // namespace portolan
