#include "mapping/lens_refinement.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <vector>

#include "map_optimization/global_bundle_adjustment.h"
#include "map_optimization/map_correction.h"
#include "mapping/newest_keyframes.h"
#include "optimization/lens_adjustment.h"

namespace portolan {
namespace {

// Of the features' distances from the principal point: as far out as features are.
constexpr double kRimQuantile = 0.95;
constexpr double kFunctionTolerance = 1e-5;  // the lens moves the cost by thousandths
constexpr double kMaxShiftShare = 0.1;       // of the rim's radius: more is no residual but another lens

/// Distance from the principal point within which nearly all measurements lie, on the plane z = 1.
double RimRadius(const BundleProblem& problem) {
  std::vector<double> radii;
  for (const auto& m : problem.measurements) radii.push_back(problem.poses[m.pose].camera.Normalize(m.pixel_px).norm());
  const auto rim = radii.begin() + static_cast<ptrdiff_t>(kRimQuantile * static_cast<double>(radii.size() - 1));
  std::nth_element(radii.begin(), rim, radii.end());
  return *rim;
}

/// Degrees from the first pose's orientation to that of the pose farthest from it.
double LargestTurn(const BundleProblem& problem) {
  double largest = 0;
  for (const auto& pose : problem.poses) {
    largest = std::max(largest,
                       problem.poses.front().camera_from_map.rotation.angularDistance(pose.camera_from_map.rotation));
  }
  return largest * 180 / M_PI;
}

/// The feature as it was before the known residual was taken out.
Eigen::Vector2d AsCalibrated(const KeyFrameData& data, uint32_t feature) {
  const Eigen::Vector2d xy =
      data.residual.Distort(data.camera.Normalize(data.features.pixels_px[feature].cast<double>()));
  return {data.camera.fx * xy.x() + data.camera.cx, data.camera.fy * xy.y() + data.camera.cy};
}

/// How far apart two lenses put a point at this radius, on the plane z = 1.
double Shift(const RadialResidual& a, const RadialResidual& b, double radius) {
  return std::abs(a.Distort({radius, 0}).x() - b.Distort({radius, 0}).x());
}

}  // namespace

LensProblem MakeLensProblem(const Map& map, const LensRefinementOptions& options) {
  LensProblem lens_problem;
  BundleProblem& problem = lens_problem.bundle;
  std::map<KeyFrameId, uint32_t> index;
  std::map<MapPointId, int> track_lengths;
  for (const KeyFrameId keyframe_id : NewestKeyFrames(map, static_cast<size_t>(options.window))) {
    const KeyFrame& keyframe = map.keyframe(keyframe_id);
    if (problem.poses.empty()) {  // the newest
      lens_problem.camera = keyframe.data->camera;
      lens_problem.known = keyframe.data->residual;
    }
    if (keyframe.data->camera != lens_problem.camera) continue;
    index.emplace(keyframe_id, static_cast<uint32_t>(problem.poses.size()));
    problem.poses.push_back({keyframe.camera_from_map, keyframe.data->camera, problem.poses.empty()});
    for (const MapPointId id : keyframe.landmarks) ++track_lengths[id];
  }
  std::vector<std::pair<MapPointId, int>> tracks(track_lengths.begin(), track_lengths.end());
  std::stable_sort(tracks.begin(), tracks.end(), [](const auto& a, const auto& b) { return a.second > b.second; });
  if (tracks.size() > static_cast<size_t>(options.max_points)) tracks.resize(static_cast<size_t>(options.max_points));
  for (const auto& [id, length] : tracks) {
    if (length < options.min_observations) break;
    const MapPoint& point = map.point(id);
    for (const Observation& o : point.observations) {
      const auto pose = index.find(o.keyframe);
      if (pose == index.end()) continue;
      const KeyFrameData& data = *map.keyframe(o.keyframe).data;
      problem.measurements.push_back({pose->second, static_cast<uint32_t>(problem.points_in_map.size()),
                                      AsCalibrated(data, o.feature),
                                      data.pyramid.Sigma(data.features.octaves[o.feature])});
    }
    problem.points_in_map.push_back(point.position_in_map.cast<double>());
  }
  return lens_problem;
}

LensFinding FindRadialResidual(const LensProblem& lens_problem, const LensRefinementOptions& options) {
  const BundleProblem& problem = lens_problem.bundle;
  const RadialResidual& known = lens_problem.known;
  if (static_cast<int>(problem.points_in_map.size()) < options.min_points) return {};
  if (LargestTurn(problem) < options.min_turn_deg) return {};
  BundleOptions bundle;
  bundle.max_iterations = options.max_iterations;
  bundle.function_tolerance = kFunctionTolerance;
  const auto adjusted = AdjustLens(problem, bundle, known);
  if (!adjusted) return {};
  const double rim = RimRadius(problem);
  const double shift = std::max(Shift(adjusted->residual, known, rim), Shift(adjusted->residual, known, rim / 2));
  const double shift_px = shift * problem.poses.front().camera.fx;
  // Twice a cost's drop, in units of the features' own noise: chi-square with two degrees of freedom if there were
  // nothing to find.
  const auto evidence_of = [&](double before, double after) {
    return 2 * (before - after) / (bundle.loss_width * bundle.loss_width);
  };
  const double evidence = evidence_of(adjusted->cost_without, adjusted->cost_with);
  // The calibration may be wrong in another way, and the residual would only stand for it.
  const double over_focal =
      (adjusted->cost_without - adjusted->cost_with) / std::max(1e-9, adjusted->cost_without - adjusted->cost_focal);
  const bool is_focal = over_focal < options.min_over_focal;
  const bool is_certain = evidence > 0 && shift_px <= options.max_sigma_px * std::sqrt(evidence);
  const bool is_significant = !is_focal && is_certain && shift_px >= options.min_shift_px &&
                              Shift(adjusted->residual, {}, rim) < kMaxShiftShare * rim &&
                              evidence >= options.min_evidence;
  spdlog::info(
      "lens: the calibration leaves k1 {:.4f} k2 {:.4f}, {:.2f} px from what is known, evidence {:.0f}, {:.1f} times a "
      "focal length's: {}",
      adjusted->residual.k1, adjusted->residual.k2, shift_px, evidence, over_focal,
      is_significant ? "taken in"
      : is_focal     ? "another focal length may explain it, left as it is"
                     : "left as it is");
  if (is_significant) return {adjusted->residual, false};
  // As certain as a residual must be. While the two explain about the same, more keyframes decide between them.
  return {{}, evidence_of(adjusted->cost_with, adjusted->cost_focal) >= options.min_evidence};
}

MapCorrection AdaptToResidual(Map map, const CameraResidual& known, const std::atomic<bool>* stop) {
  map.SetResidual(known.camera, known.residual);
  auto adjusted = AdjustGlobally(map, {}, stop, nullptr);
  if (adjusted.ok()) return std::move(adjusted).value();
  spdlog::info("lens: the map stays where it is: {}", adjusted.error().message);
  MapCorrection unmoved = EmptyCorrection(map, "lens");
  for (const auto& [id, keyframe] : map.keyframes()) unmoved.keyframes.push_back({id, Sim3d(keyframe.camera_from_map)});
  return unmoved;
}

}  // namespace portolan
