#include "atlas/place_locator.h"

#include <fmt/format.h>

#include <algorithm>
#include <set>

#include "base/time.h"
#include "features/feature_matcher.h"
#include "geometry/absolute_pose.h"

namespace portolan {
namespace {

struct Found {
  const OtherMap* map = nullptr;
  Candidate candidate;
};

std::vector<Found> FindBest(const BowVector& bow, const std::vector<OtherMap>& maps, const LocatorOptions& options) {
  std::vector<const OtherMap*> looked_in;
  size_t looked_up = 0;
  for (const OtherMap& map : maps) {
    if (looked_up > 0 && looked_up + map.num_keyframes() > options.max_looked_up) break;
    looked_up += map.num_keyframes();
    looked_in.push_back(&map);
  }
  const auto shared = QueryMaps(bow, looked_in);
  std::vector<Found> found;
  for (size_t m = 0; m < looked_in.size(); ++m) {
    for (const Candidate& candidate : FindCandidates(shared[m], looked_in[m]->neighbours, options.candidates, nullptr))
      found.push_back({looked_in[m], candidate});
  }
  std::stable_sort(found.begin(), found.end(), [](const Found& a, const Found& b) {
    return a.candidate.accumulated_score > b.candidate.accumulated_score;
  });
  return found;
}

/// The frame's features that look like landmarks of a keyframe and its neighbours, each landmark and each feature once.
struct Matches {
  std::vector<Eigen::Vector3d> landmarks_in_map;
  std::vector<Eigen::Vector2d> pixels_px;
  std::vector<double> sigmas_px;
};

Matches MatchLandmarks(const KeyFrameData& frame, const Map& map, const std::vector<KeyFrameId>& keyframes,
                       const MatcherOptions& options) {
  Matches matches;
  std::set<MapPointId> landmarks;
  std::set<uint32_t> features;
  for (const KeyFrameId id : keyframes) {
    const KeyFrame& keyframe = map.keyframe(id);
    if (!keyframe.data->features.HasAppearance()) continue;
    const std::vector<MapPointId> ids = keyframe.landmarks.ByFeature();
    for (const FeatureMatch& match : MatchByNodes(
             keyframe.data->features, keyframe.data->nodes, frame.features, frame.nodes, options,
             [&](uint32_t i) { return ids[i].IsValid(); }, nullptr)) {
      if (features.count(match.second) == 1 || !landmarks.insert(ids[match.first]).second) continue;
      features.insert(match.second);
      matches.landmarks_in_map.push_back(map.point(ids[match.first]).position_in_map.cast<double>());
      matches.pixels_px.push_back(frame.features.pixels_px[match.second].cast<double>());
      matches.sigmas_px.push_back(frame.pyramid.Sigma(frame.features.octaves[match.second]));
    }
  }
  return matches;
}

Result<LocatedFrame> Verify(const KeyFrameData& frame, const Map& map, KeyFrameId candidate,
                            const std::vector<KeyFrameId>& keyframes, const LocatorOptions& options) {
  const Matches matches = MatchLandmarks(frame, map, keyframes, options.words);
  if (static_cast<int>(matches.pixels_px.size()) < options.min_matches)
    return Error{
        fmt::format("{} landmarks matched by words, expected {}", matches.pixels_px.size(), options.min_matches)};
  AbsolutePoseOptions pose_options;
  pose_options.min_inliers = options.min_inliers;
  const Result<AbsolutePose> pose =
      EstimateAbsolutePose(frame.camera, matches.landmarks_in_map, matches.pixels_px, matches.sigmas_px, pose_options);
  if (!pose) return pose.error();
  return LocatedFrame{map.id(), candidate, pose->num_inliers, pose->camera_from_map};
}

}  // namespace

Result<LocatedFrame> LocateFrame(const KeyFrameData& frame, const BowVector& bow, const std::vector<OtherMap>& maps,
                                 const OverlapDetector::EnsureAppearance& ensure, const LocatorOptions& options,
                                 StageTimes* times) {
  const Stopwatch stopwatch;
  const std::vector<Found> candidates = FindBest(bow, maps, options);
  Result<LocatedFrame> best = Error{candidates.empty() ? "no keyframe of another map shares words with it" : ""};
  int tried = 0;
  for (const Found& found : candidates) {
    if (tried == options.max_verified) break;
    const Map* map = found.map->open();
    if (map == nullptr) continue;
    const std::vector<KeyFrameId> keyframes = KeyFramesRead(*map, found.candidate.keyframe, {}, options.word_keyframes);
    if (ensure && !ensure(*map, keyframes)) continue;
    ++tried;
    Result<LocatedFrame> located = Verify(frame, *map, found.candidate.keyframe, keyframes, options);
    const std::string place = "keyframe " + ToString(found.candidate.keyframe) + " of map " + ToString(map->id());
    if (!located && !best && best.error().message.empty())
      best = Error{"best candidate is " + place + ": " + located.error().message};
    if (located && (!best || best->inliers < located->inliers)) best = std::move(located);
  }
  if (!best && best.error().message.empty())
    best = Error{"the maps or the descriptors of the candidates are still being read"};
  times->Add("locate", stopwatch.Milliseconds());
  return best;
}

}  // namespace portolan
