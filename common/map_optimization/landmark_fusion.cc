#include "map_optimization/landmark_fusion.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <unordered_set>

#include "map/keyframe_view.h"

namespace portolan {
namespace {

/// The feature that shows the landmark, by place, octave and descriptor.
std::optional<uint32_t> FindFeature(const KeyFrameView& view, const MapPoint& point, const PredictedFeature& predicted,
                                    const LandmarkFusionOptions& options, std::vector<uint32_t>* nearby) {
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

/// Of equals, the older.
bool HasMoreObservations(const MapPoint& a, const MapPoint& b) {
  return a.observations.size() != b.observations.size() ? a.observations.size() > b.observations.size() : a.id < b.id;
}

}  // namespace

void FuseIntoKeyFrame(Map* map, KeyFrameId target, const std::vector<MapPointId>& points,
                      const LandmarkFusionOptions& options, FusionResult* result) {
  const KeyFrameView view(map->keyframe(target));
  if (!view.data().features.HasAppearance()) return;
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
      const bool keep_projected = options.keep_projected || HasMoreObservations(*point, map->point(present));
      const MapPointId from = keep_projected ? present : id, into = keep_projected ? id : present;
      map->MergePoints(from, into);
      result->merges.emplace_back(from, into);
    } else if (map->AddObservation(id, target, *feature)) {
      result->observations.emplace_back(id, Observation{target, *feature});
    }
  }
}

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

}  // namespace portolan
