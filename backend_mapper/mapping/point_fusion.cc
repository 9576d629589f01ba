#include "mapping/point_fusion.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <unordered_set>

#include "mapping/keyframe_view.h"

namespace portolan {
namespace {

std::vector<MapPointId> LandmarksOf(const KeyFrame& keyframe) {
  return {keyframe.landmarks.begin(), keyframe.landmarks.end()};
}

/// Landmarks of several keyframes, each once, in order of first appearance.
std::vector<MapPointId> LandmarksOf(const Map& map, const std::vector<KeyFrameId>& keyframes) {
  std::vector<MapPointId> landmarks;
  std::unordered_set<MapPointId> seen;
  for (const KeyFrameId keyframe : keyframes) {
    for (const MapPointId id : map.keyframe(keyframe).landmarks) {
      if (seen.insert(id).second) landmarks.push_back(id);
    }
  }
  return landmarks;
}

/// The feature that shows the landmark, by place, octave and descriptor.
std::optional<uint32_t> FindFeature(const KeyFrameView& view, const MapPoint& point, const PredictedFeature& predicted,
                                    const FusionOptions& options, std::vector<uint32_t>* nearby) {
  const FeatureSet& features = view.data().features;
  nearby->clear();
  // As far as the error may be at the coarsest octave searched.
  const int coarsest = std::min(predicted.octave + 1, view.data().pyramid.levels - 1);
  const double radius_px = std::sqrt(options.chi2) * view.Scale(coarsest);
  view.data().grid.Find(features, predicted.pixel_px, radius_px, predicted.octave - 1, coarsest, nearby);
  std::optional<uint32_t> best;
  int best_distance = options.max_distance + 1;
  for (const uint32_t feature : *nearby) {
    const double squared_px = (view.Pixel(feature) - predicted.pixel_px).squaredNorm();
    if (squared_px > options.chi2 * view.Sigma(feature) * view.Sigma(feature)) continue;
    const int distance = HammingDistance(point.descriptor, features.descriptors[feature]);
    if (distance >= best_distance) continue;
    best_distance = distance;
    best = feature;
  }
  return best;
}

void Merge(Map* map, const MapPoint& a, const MapPoint& b, FusionResult* result) {
  const bool keep_a =
      a.observations.size() != b.observations.size() ? a.observations.size() > b.observations.size() : a.id < b.id;
  const MapPointId from = keep_a ? b.id : a.id, into = keep_a ? a.id : b.id;
  map->MergePoints(from, into);
  result->merges.emplace_back(from, into);
}

/// Neighbours, best first, and after them their neighbours.
std::vector<KeyFrameId> SelectTargets(const Map& map, KeyFrameId keyframe, const FusionOptions& options) {
  std::vector<KeyFrameId> targets;
  const auto add = [&](KeyFrameId id) {
    if (id != keyframe && std::find(targets.begin(), targets.end(), id) == targets.end()) targets.push_back(id);
  };
  const auto neighbours = map.CovisibleKeyFrames(keyframe, 1, static_cast<size_t>(options.neighbours));
  for (const auto& [id, common] : neighbours) add(id);
  for (const auto& [id, common] : neighbours) {
    if (options.second_neighbours == 0) break;
    for (const auto& [second, second_common] :
         map.CovisibleKeyFrames(id, 1, static_cast<size_t>(options.second_neighbours))) {
      add(second);
    }
  }
  if (targets.size() > static_cast<size_t>(options.max_keyframes))
    targets.resize(static_cast<size_t>(options.max_keyframes));
  return targets;
}

}  // namespace

void FuseIntoKeyFrame(Map* map, KeyFrameId target, const std::vector<MapPointId>& points, const FusionOptions& options,
                      FusionResult* result) {
  const KeyFrameView view(map->keyframe(target));
  std::vector<uint32_t> nearby;
  for (const MapPointId id : points) {
    const MapPoint* point = map->FindPoint(id);
    if (point == nullptr || point->FindObservation(target) != nullptr) continue;
    const auto predicted = view.Predict(*point);
    if (!predicted) continue;
    const auto feature = FindFeature(view, *point, *predicted, options, &nearby);
    if (!feature) continue;
    const MapPointId present = view.keyframe().landmarks[*feature];
    if (present.IsValid()) {
      Merge(map, *point, map->point(present), result);
    } else if (map->AddObservation(id, target, *feature)) {
      ++result->observations;
    }
  }
}

FusionResult FuseWithNeighbours(Map* map, KeyFrameId keyframe, const FusionOptions& options) {
  FusionResult result;
  map->RefreshDerived();
  const std::vector<KeyFrameId> targets = SelectTargets(*map, keyframe, options);
  for (const KeyFrameId target : targets) {
    FuseIntoKeyFrame(map, target, LandmarksOf(map->keyframe(keyframe)), options, &result);
  }
  map->RefreshDerived();
  FuseIntoKeyFrame(map, keyframe, LandmarksOf(*map, targets), options, &result);
  map->RefreshDerived();
  return result;
}

}  // namespace portolan
