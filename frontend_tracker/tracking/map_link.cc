#include "tracking/map_link.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "base/statistics.h"

namespace portolan {
namespace {

double DepthOf(const FrameInMap& frame, MapPointId id) {
  const MapPoint* point = id.IsValid() ? frame.map.FindPoint(id) : nullptr;
  return point == nullptr ? 0 : (frame.camera_from_map * point->position_in_map.cast<double>()).z();
}

/// Standard error of the median of samples, from their median absolute deviation, which outliers hardly move.
double ErrorOfMedian(const std::vector<double>& samples, double median) {
  constexpr double kSigmaOverDeviation = 1.4826, kMedianOverMean = 1.2533;  // of a normal distribution
  std::vector<double> deviations;
  for (const double sample : samples) deviations.push_back(std::abs(sample - median));
  return kMedianOverMean * kSigmaOverDeviation * Quantile(std::move(deviations), 0.5) /
         std::sqrt(static_cast<double>(samples.size()));
}

std::optional<double> ScaleOf(const Overlap& overlap) {
  if (overlap.depths.size() < kFewOverlapFeatures) return std::nullopt;
  std::vector<double> ratios;
  for (const auto& [in_map, in_other] : overlap.depths) ratios.push_back(in_map / in_other);
  const double scale = Quantile(ratios, 0.5);
  if (ratios.size() < kMinOverlapFeatures && ErrorOfMedian(ratios, scale) > kMaxScaleError * scale) return std::nullopt;
  return scale;
}

/// How far two links put a camera and what it sees apart: turn in radians, and shift in units of what it sees. @param
/// depth in the target map's units.
double Disagreement(const Sim3d& a, const Sim3d& b, const Eigen::Vector3d& camera_in_other, double depth) {
  return a.rotation.angularDistance(b.rotation) + (a * camera_in_other - b * camera_in_other).norm() / depth;
}

double MedianDepthInMap(const Overlap& overlap) {
  std::vector<double> depths;
  for (const auto& [in_map, in_other] : overlap.depths) depths.push_back(in_map);
  return Quantile(std::move(depths), 0.5);
}

/// From the camera's places, in pairs that are at least half as far apart as any are; none if there are too few frames
/// or the way is too short.
std::optional<double> ScaleOfWay(const std::vector<const Overlap*>& overlaps) {
  if (overlaps.size() < kMinWayFrames) return std::nullopt;
  std::vector<std::pair<double, double>> distances;  // in the map, in the other
  double most = 0, depth = 0;
  for (size_t i = 0; i < overlaps.size(); ++i) {
    depth = std::max(depth, MedianDepthInMap(*overlaps[i]));
    for (size_t k = i + 1; k < overlaps.size(); ++k) {
      const Overlap &a = *overlaps[i], &b = *overlaps[k];
      const double in_map =
          (a.camera_from_map.TargetOriginInSource() - b.camera_from_map.TargetOriginInSource()).norm();
      distances.emplace_back(
          in_map, (a.camera_from_other.TargetOriginInSource() - b.camera_from_other.TargetOriginInSource()).norm());
      most = std::max(most, in_map);
    }
  }
  if (most < kMinWayInDepths * depth) return std::nullopt;
  std::vector<double> ratios;
  for (const auto& [in_map, in_other] : distances) {
    if (in_map >= most / 2 && in_other > 0) ratios.push_back(in_map / in_other);
  }
  if (ratios.empty()) return std::nullopt;
  return Quantile(std::move(ratios), 0.5);
}

}  // namespace

Overlap MakeOverlap(const FrameInMap& in_map, const FrameInMap& in_other) {
  Overlap overlap{in_map.camera_from_map, in_other.camera_from_map, {}};
  const size_t features = std::min(in_map.landmarks.size(), in_other.landmarks.size());
  for (size_t i = 0; i < features; ++i) {
    const double depth = DepthOf(in_map, in_map.landmarks[i]),
                 depth_in_other = DepthOf(in_other, in_other.landmarks[i]);
    if (depth > 0 && depth_in_other > 0) overlap.depths.emplace_back(depth, depth_in_other);
  }
  return overlap;
}

Sim3d LinkThroughCamera(const Rigid3d& camera_from_map, const Rigid3d& camera_from_other, double scale) {
  return Sim3d(camera_from_map.Inverse()) * Sim3d(scale, Eigen::Quaterniond::Identity(), Eigen::Vector3d::Zero()) *
         Sim3d(camera_from_other);
}

std::optional<Sim3d> MeasureLink(const std::vector<Overlap>& overlaps) {
  std::vector<const Overlap*> used;
  std::vector<double> scales;
  for (const Overlap& overlap : overlaps) {
    const std::optional<double> scale = ScaleOf(overlap);
    if (!scale) continue;
    used.push_back(&overlap);
    scales.push_back(*scale);
  }
  if (used.empty()) return std::nullopt;
  const double scale = ScaleOfWay(used).value_or(Quantile(scales, 0.5));
  std::vector<Sim3d> links;
  for (const Overlap* overlap : used)
    links.push_back(LinkThroughCamera(overlap->camera_from_map, overlap->camera_from_other, scale));
  size_t best = 0;
  double least = std::numeric_limits<double>::infinity();
  for (size_t i = 0; i < links.size(); ++i) {
    double sum = 0;
    for (size_t k = 0; k < links.size(); ++k) {
      sum += Disagreement(links[i], links[k], used[k]->camera_from_other.TargetOriginInSource(),
                          MedianDepthInMap(*used[k]));
    }
    if (sum < least) {
      least = sum;
      best = i;
    }
  }
  return links[best];
}

}  // namespace portolan
