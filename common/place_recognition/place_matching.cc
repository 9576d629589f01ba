#include "place_recognition/place_matching.h"

#include <algorithm>
#include <unordered_map>
#include <unordered_set>
#include <utility>

namespace portolan {
namespace {

/// The landmark that a feature shows, if it is one of its side.
const MapPoint* LandmarkOf(const std::unordered_map<MapPointId, const MapPoint*>& side, const KeyFrame& keyframe,
                           uint32_t feature) {
  const auto found = side.find(keyframe.landmarks[feature]);
  return found == side.end() ? nullptr : found->second;
}

std::unordered_map<MapPointId, const MapPoint*> ById(const Neighbourhood& side) {
  std::unordered_map<MapPointId, const MapPoint*> by_id;
  by_id.reserve(side.landmarks.size());
  for (const MapPoint* point : side.landmarks) by_id.emplace(point->id, point);
  return by_id;
}

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

SideView ViewOf(const KeyFrame& observer, uint32_t feature, const KeyFrame& side) {
  const KeyFrameData& data = *observer.data;
  return {&data.camera, observer.camera_from_map * side.camera_from_map.Inverse(),
          data.features.pixels_px[feature].cast<double>(), data.pyramid.Sigma(data.features.octaves[feature])};
}

/// The two views of ToSim3Matches; one if no other keyframe of the side sees the landmark.
std::vector<SideView> ViewsOf(const MapPoint& point, const Neighbourhood& side) {
  std::vector<SideView> views;
  double farthest = -1;
  for (const KeyFrame* keyframe : side.keyframes) {
    const Observation* observation = point.FindObservation(keyframe->data->id);
    if (observation == nullptr) continue;
    const SideView view = ViewOf(*keyframe, observation->feature, side.keyframe());
    if (views.empty()) {
      views.push_back(view);
      continue;
    }
    const double distance =
        (view.camera_from_side.TargetOriginInSource() - views[0].camera_from_side.TargetOriginInSource()).norm();
    if (distance <= farthest) continue;
    farthest = distance;
    views.resize(1);
    views.push_back(view);
  }
  return views;
}

}  // namespace

std::vector<LandmarkPair> MatchByWords(const Neighbourhood& query, const Neighbourhood& candidate, size_t keyframes,
                                       const MatcherOptions& options) {
  const auto query_side = ById(query), candidate_side = ById(candidate);
  const KeyFrame& first = query.keyframe();
  std::vector<LandmarkPair> pairs;
  for (size_t k = 0; k < std::min(keyframes, candidate.keyframes.size()); ++k) {
    const KeyFrame& second = *candidate.keyframes[k];
    const std::vector<FeatureMatch> matches = MatchByNodes(
        first.data->features, first.data->nodes, second.data->features, second.data->nodes, options,
        [&](uint32_t i) { return LandmarkOf(query_side, first, i) != nullptr; },
        [&](uint32_t j) { return LandmarkOf(candidate_side, second, j) != nullptr; });
    for (const FeatureMatch& match : matches) {
      pairs.push_back({match.first, LandmarkOf(query_side, first, match.first),
                       LandmarkOf(candidate_side, second, match.second), match.distance});
    }
  }
  return KeepClosest(std::move(pairs));
}

std::vector<LandmarkPair> MatchByProjection(const Neighbourhood& query, const Neighbourhood& candidate,
                                            const Sim3d& query_map_from_candidate_map,
                                            const LandmarkSearchOptions& options) {
  const auto query_side = ById(query), candidate_side = ById(candidate);
  const KeyFrame& first = query.keyframe();
  const KeyFrame& second = candidate.keyframe();
  std::vector<LandmarkPair> pairs;
  const Rigid3d query_from_candidate_map =
      TransformPose(first.camera_from_map, query_map_from_candidate_map.Inverse());
  for (const FoundLandmark& found :
       FindLandmarks(candidate.landmarks, query_from_candidate_map, *first.data, options).found) {
    const MapPoint* at = LandmarkOf(query_side, first, found.feature);
    if (at != nullptr) pairs.push_back({found.feature, at, candidate.landmarks[found.landmark], found.distance});
  }
  std::vector<const MapPoint*> of_keyframe;
  std::vector<uint32_t> features;
  for (uint32_t i = 0; i < first.landmarks.size(); ++i) {
    const MapPoint* landmark = LandmarkOf(query_side, first, i);
    if (landmark == nullptr) continue;
    of_keyframe.push_back(landmark);
    features.push_back(i);
  }
  const Rigid3d candidate_from_query_map = TransformPose(second.camera_from_map, query_map_from_candidate_map);
  for (const FoundLandmark& found : FindLandmarks(of_keyframe, candidate_from_query_map, *second.data, options).found) {
    const MapPoint* at = LandmarkOf(candidate_side, second, found.feature);
    if (at != nullptr) pairs.push_back({features[found.landmark], of_keyframe[found.landmark], at, found.distance});
  }
  return KeepClosest(std::move(pairs));
}

std::vector<Sim3Match> ToSim3Matches(const std::vector<LandmarkPair>& pairs, const Neighbourhood& query,
                                     const Neighbourhood& candidate) {
  std::vector<Sim3Match> matches;
  for (const LandmarkPair& pair : pairs) {
    Sim3Match match;
    match.point_in_a = candidate.keyframe().camera_from_map * pair.candidate->position_in_map.cast<double>();
    match.point_in_b = query.keyframe().camera_from_map * pair.query->position_in_map.cast<double>();
    match.views_in_a = ViewsOf(*pair.candidate, candidate);
    match.views_in_b = ViewsOf(*pair.query, query);
    matches.push_back(std::move(match));
  }
  return matches;
}

}  // namespace portolan
