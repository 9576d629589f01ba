#include "place_recognition/landmark_search.h"

#include <algorithm>

#include "map/landmark_projection.h"

namespace portolan {
namespace {

constexpr int kNobody = 257;  // farther than any descriptor

/// Nearest descriptor among features. @return distance kNobody if there is none.
FoundLandmark Nearest(const Descriptor& descriptor, const FeatureSet& features, const std::vector<uint32_t>& among) {
  FoundLandmark best;
  best.distance = kNobody;
  for (const uint32_t feature : among) {
    const int distance = HammingDistance(descriptor, features.descriptors[feature]);
    if (distance >= best.distance) continue;
    best.distance = distance;
    best.feature = feature;
  }
  return best;
}

}  // namespace

LandmarkSearchResult FindLandmarks(const std::vector<const MapPoint*>& landmarks, const Rigid3d& camera_from_map,
                                   const KeyFrameData& image, const LandmarkSearchOptions& options) {
  LandmarkSearchResult result;
  const LandmarkProjection projection(image.camera, image.pyramid, camera_from_map);
  const FeatureSet& features = image.features;
  const std::vector<double> scales = image.pyramid.Scales();
  FoundLandmark nobody;
  nobody.distance = kNobody;
  std::vector<FoundLandmark> owner_of_feature(features.size(), nobody);
  std::vector<uint32_t> near;
  for (size_t i = 0; i < landmarks.size(); ++i) {
    const auto predicted = projection.Predict(*landmarks[i]);
    if (!predicted) continue;
    ++result.visible;
    near.clear();
    const double radius_px = options.radius_px * scales[static_cast<size_t>(predicted->octave)];
    image.grid.Find(features, predicted->pixel_px, radius_px, predicted->octave - 1, predicted->octave + 1, &near);
    FoundLandmark found = Nearest(landmarks[i]->descriptor, features, near);
    if (found.distance > options.max_distance) continue;
    found.landmark = i;
    const Eigen::Vector2d offset_px = features.pixels_px[found.feature].cast<double>() - predicted->pixel_px;
    found.error_px = offset_px.norm() / scales[features.octaves[found.feature]];
    FoundLandmark& owner = owner_of_feature[found.feature];
    if (found.distance < owner.distance) owner = found;
  }
  for (const FoundLandmark& owner : owner_of_feature) {
    if (owner.distance != kNobody) result.found.push_back(owner);
  }
  std::sort(result.found.begin(), result.found.end(),
            [](const FoundLandmark& a, const FoundLandmark& b) { return a.landmark < b.landmark; });
  return result;
}

}  // namespace portolan
