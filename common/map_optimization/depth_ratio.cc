#include "map_optimization/depth_ratio.h"

#include <algorithm>
#include <vector>

namespace portolan {
namespace {

constexpr size_t kMinLandmarks = 10;  // the median of fewer is no better than what the neighbours say

double DepthIn(const KeyFrame& keyframe, const MapPoint& point) {
  return (keyframe.camera_from_map * point.position_in_map.cast<double>()).z();
}

}  // namespace

double DepthRatio(const Map& old_map, const Map& new_map, KeyFrameId keyframe,
                  const std::unordered_set<MapPointId>& points, double otherwise) {
  const KeyFrame& before = old_map.keyframe(keyframe);
  const KeyFrame& after = new_map.keyframe(keyframe);
  std::vector<double> ratios;
  const std::vector<MapPointId> old_ids = before.landmarks.ByFeature(), new_ids = after.landmarks.ByFeature();
  for (size_t feature = 0; feature < new_ids.size(); ++feature) {
    const MapPointId old_id = old_ids[feature], new_id = new_ids[feature];
    if (!old_id.IsValid() || !new_id.IsValid() || points.count(new_id) == 0) continue;
    const double old_depth = DepthIn(before, old_map.point(old_id)), new_depth = DepthIn(after, new_map.point(new_id));
    if (old_depth > 0 && new_depth > 0) ratios.push_back(old_depth / new_depth);
  }
  if (ratios.size() < kMinLandmarks) return otherwise;
  const auto middle = ratios.begin() + static_cast<ptrdiff_t>(ratios.size() / 2);
  std::nth_element(ratios.begin(), middle, ratios.end());
  return *middle;
}

}  // namespace portolan
