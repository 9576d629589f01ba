#include "tracking/tracked_pair.h"

#include <algorithm>
#include <array>
#include <limits>
#include <unordered_map>

#include "features/feature_matcher.h"
#include "tracking/frame_ring.h"

namespace portolan {
namespace {

constexpr double kRadiusPx = 20.0;  // around the prediction, whose depth is that of the neighbours
constexpr size_t kNeighbours = 3;

/// A feature whose depth is known.
struct KnownDepth {
  Eigen::Vector2f pixel_px;
  double inverse_depth = 0;
};

std::vector<KnownDepth> KnownDepths(const Map& map, const Frame& frame) {
  std::vector<KnownDepth> known;
  for (size_t i = 0; i < frame.landmarks.size(); ++i) {
    const MapPoint* point = frame.landmarks[i].IsValid() ? map.FindPoint(frame.landmarks[i]) : nullptr;
    if (point == nullptr) continue;
    const double depth = (frame.camera_from_map * point->position_in_map.cast<double>()).z();
    if (depth > 0) known.push_back({frame.data->features.pixels_px[i], 1 / depth});
  }
  return known;
}

/// Median of the nearest known ones.
double InverseDepthAt(const Eigen::Vector2f& pixel_px, const std::vector<KnownDepth>& known) {
  std::array<std::pair<float, double>, kNeighbours> nearest;
  nearest.fill({std::numeric_limits<float>::infinity(), 0.0});
  for (const KnownDepth& one : known) {
    const float distance = (one.pixel_px - pixel_px).squaredNorm();
    if (distance >= nearest.back().first) continue;
    nearest.back() = {distance, one.inverse_depth};
    std::sort(nearest.begin(), nearest.end());
  }
  std::sort(nearest.begin(), nearest.end(), [](const auto& a, const auto& b) { return a.second < b.second; });
  return nearest[kNeighbours / 2].second;
}

std::vector<Eigen::Vector2d> PredictPixels(const Map& map, const Frame& first, const Rigid3d& second_from_first) {
  const std::vector<KnownDepth> known = KnownDepths(map, first);
  const FeatureSet& features = first.data->features;
  const PinholeCamera& camera = first.data->camera;
  std::vector<Eigen::Vector2d> predicted(features.size(),
                                         Eigen::Vector2d::Constant(std::numeric_limits<double>::quiet_NaN()));
  if (known.size() < kNeighbours) return predicted;
  for (size_t i = 0; i < features.size(); ++i) {
    // The ray's point, scaled by its inverse depth.
    const Eigen::Vector3d in_second =
        second_from_first.rotation * camera.Unproject(features.pixels_px[i].cast<double>()) +
        InverseDepthAt(features.pixels_px[i], known) * second_from_first.translation;
    if (in_second.z() > 0) predicted[i] = camera.Project(in_second);
  }
  return predicted;
}

/// (feature of first, feature of second) of the landmarks that both frames see.
std::vector<std::pair<uint32_t, uint32_t>> CommonLandmarks(const Frame& first, const Frame& second) {
  std::unordered_map<MapPointId, uint32_t> feature_of;
  for (size_t i = 0; i < first.landmarks.size(); ++i) {
    if (first.landmarks[i].IsValid()) feature_of.emplace(first.landmarks[i], static_cast<uint32_t>(i));
  }
  std::vector<std::pair<uint32_t, uint32_t>> common;
  for (size_t i = 0; i < second.landmarks.size(); ++i) {
    const auto same = feature_of.find(second.landmarks[i]);
    if (!second.landmarks[i].IsValid() || same == feature_of.end()) continue;
    common.emplace_back(same->second, static_cast<uint32_t>(i));
    feature_of.erase(same);
  }
  return common;
}

}  // namespace

std::optional<Initializer::Pair> MakeTrackedPair(const Map& map, const Frame& first, const Frame& second,
                                                 const InitializerOptions& options) {
  Initializer::Pair pair;
  const Rigid3d second_from_first = second.camera_from_map * first.camera_from_map.Inverse();
  pair.matches = CommonLandmarks(first, second);
  std::vector<bool> first_used(first.data->features.size()), second_used(second.data->features.size());
  for (const auto& [i, j] : pair.matches) first_used[i] = second_used[j] = true;
  MatcherOptions matcher;
  matcher.ratio = 0.9;  // windows are small, and triangulation checks the matches
  for (const FeatureMatch& match : MatchByWindow(first.data->features, PredictPixels(map, first, second_from_first),
                                                 second.data->features, second.data->grid, kRadiusPx, matcher)) {
    if (!first_used[match.first] && !second_used[match.second]) pair.matches.emplace_back(match.first, match.second);
  }
  if (static_cast<int>(pair.matches.size()) < options.min_matches) return std::nullopt;
  pair.first = first;
  pair.second = second;
  pair.second_from_first = second_from_first.rotation;
  pair.translation = second_from_first.translation;
  size_t num_common = 0;
  pair.baseline_px = CompensatedMotionPx(first, second, &num_common);
  return pair;
}

}  // namespace portolan
