// What a map derives from observations, positions and poses: viewing directions, distances and descriptors of its
// points.

#include <algorithm>
#include <array>
#include <limits>
#include <unordered_map>
#include <vector>

#include "features/feature_set.h"
#include "map/map.h"

namespace portolan {
namespace {

/// Observations whose descriptors are compared for the most typical one: time grows with the square, and more tell
/// little more.
constexpr size_t kMostCompared = 16;

/// A keyframe as RefreshDerived needs it, point after point.
struct View {
  Eigen::Vector3f centre_in_map;
  const FeatureSet* features = nullptr;
  std::vector<float> scales;  // of the pyramid's levels
};

using Views = std::unordered_map<KeyFrameId, View>;

const View& FindView(const Map& map, KeyFrameId id, Views* views) {
  View& view = (*views)[id];
  if (view.features == nullptr) {
    const KeyFrame& keyframe = map.keyframe(id);
    view.centre_in_map = keyframe.camera_from_map.TargetOriginInSource().cast<float>();
    view.features = &keyframe.data->features;
    for (const double scale : keyframe.data->pyramid.Scales()) view.scales.push_back(static_cast<float>(scale));
  }
  return view;
}

void RefreshGeometry(const Map& map, Views* views, MapPoint* point) {
  Eigen::Vector3f direction_sum = Eigen::Vector3f::Zero();
  float nearest = std::numeric_limits<float>::max(), farthest = 0;
  for (const Observation& o : point->observations) {
    const View& view = FindView(map, o.keyframe, views);
    const Eigen::Vector3f ray = point->position_in_map - view.centre_in_map;
    const float distance = ray.norm();
    if (distance > 0) direction_sum += ray / distance;
    // A feature of level l seen at distance d would be at level 0 from d * factor^l and at the top level from d *
    // factor^(l - top).
    const float at_level_0 = distance * view.scales[view.features->octaves[o.feature]];
    farthest = std::max(farthest, at_level_0);
    nearest = std::min(nearest, at_level_0 / view.scales.back());
  }
  const float norm = direction_sum.norm();
  point->mean_viewing_direction = norm > 0 ? Eigen::Vector3f(direction_sum / norm) : Eigen::Vector3f::UnitZ();
  point->min_distance = nearest;
  point->max_distance = farthest;
}

/// Index of the descriptor with the least median Hamming distance to the others (the first of equals).
size_t MostTypical(const std::array<const Descriptor*, kMostCompared>& descriptors, size_t count) {
  std::array<std::array<int, kMostCompared>, kMostCompared> distances{};
  for (size_t i = 0; i < count; ++i) {
    for (size_t j = i + 1; j < count; ++j)
      distances[i][j] = distances[j][i] = HammingDistance(*descriptors[i], *descriptors[j]);
  }
  size_t best = 0;
  int best_median = std::numeric_limits<int>::max();
  for (size_t i = 0; i < count; ++i) {
    std::swap(distances[i][i], distances[i][count - 1]);  // its distance to itself says nothing
    const auto begin = distances[i].begin(), middle = begin + static_cast<ptrdiff_t>((count - 2) / 2);
    std::nth_element(begin, middle, begin + static_cast<ptrdiff_t>(count - 1));
    if (*middle < best_median) {
      best_median = *middle;
      best = i;
    }
  }
  return best;
}

/// Of many observations some, evenly from the oldest to the youngest. Those whose descriptors were dropped say nothing.
void RefreshDescriptor(const Map& map, Views* views, MapPoint* point) {
  std::array<const Descriptor*, kMostCompared> descriptors{};
  const size_t all = point->observations.size(), chosen = std::min(all, kMostCompared);
  size_t count = 0;
  for (size_t i = 0; i < chosen; ++i) {
    const Observation& o = point->observations[chosen == all ? i : i * (all - 1) / (chosen - 1)];
    const FeatureSet& features = *FindView(map, o.keyframe, views).features;
    if (features.HasAppearance()) descriptors[count++] = &features.descriptors[o.feature];
  }
  if (count == 0) return;
  point->descriptor = *descriptors[count < 3 ? count - 1 : MostTypical(descriptors, count)];  // of two the younger
}

}  // namespace

void Map::MarkStale(MapPoint* point, uint8_t what) {
  if (point->stale == 0) stale_points_.push_back(point->id);
  point->stale |= what;
}

void Map::RefreshDerived() {
  for (const KeyFrameId id : moved_keyframes_) {
    const KeyFrame* keyframe = FindKeyFrame(id);
    if (keyframe == nullptr) continue;
    for (const MapPointId landmark : keyframe->landmarks) MarkStale(&points_.at(landmark), kGeometryStale);
  }
  moved_keyframes_.clear();
  Views views;
  for (const MapPointId id : stale_points_) {
    const auto found = points_.find(id);
    if (found == points_.end() || found->second.stale == 0) continue;
    MapPoint& point = found->second;
    if (!point.observations.empty()) {
      RefreshGeometry(*this, &views, &point);
      if ((point.stale & kDescriptorStale) != 0) RefreshDescriptor(*this, &views, &point);
    }
    point.stale = 0;
  }
  stale_points_.clear();
}

}  // namespace portolan
