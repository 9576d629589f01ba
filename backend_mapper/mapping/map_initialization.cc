#include "mapping/map_initialization.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "base/ids.h"
#include "optimization/bundle_adjustment.h"

namespace portolan {
namespace {

using FeaturePairs = std::vector<std::pair<uint32_t, uint32_t>>;

// Below a depth of this share of the baseline, a point would sit in the camera itself.
constexpr double kMinDepth = 1e-3;

Result<PixelMatches> GatherPixels(const KeyFrameData& first, const KeyFrameData& second, const FeaturePairs& matches) {
  PixelMatches pixels;
  pixels.first_px.reserve(matches.size());
  pixels.second_px.reserve(matches.size());
  std::vector<bool> first_used(first.features.size()), second_used(second.features.size());
  for (const auto& [i, j] : matches) {
    if (i >= first.features.size() || j >= second.features.size()) {
      return Error{"initial match (" + std::to_string(i) + ", " + std::to_string(j) + ") of keyframes " +
                   ToString(first.id) + " and " + ToString(second.id) + ": they have " +
                   std::to_string(first.features.size()) + " and " + std::to_string(second.features.size()) +
                   " features"};
    }
    if (first_used[i] || second_used[j]) {
      return Error{"initial match (" + std::to_string(i) + ", " + std::to_string(j) + ") uses a feature twice"};
    }
    first_used[i] = second_used[j] = true;
    pixels.first_px.push_back(first.features.pixels_px[i].cast<double>());
    pixels.second_px.push_back(second.features.pixels_px[j].cast<double>());
  }
  return pixels;
}

void AddMeasurement(const KeyFrameData& data, uint32_t feature, uint32_t camera, uint32_t point,
                    BundleProblem* problem) {
  BundleProblem::Measurement measurement;
  measurement.pose = camera;
  measurement.point = point;
  measurement.pixel_px = data.features.pixels_px[feature].cast<double>();
  measurement.sigma_px = data.pyramid.Sigma(data.features.octaves[feature]);
  problem->measurements.push_back(measurement);
}

/// The structure as a problem of two poses, the first fixed; measurements 2k and 2k + 1 are point k's.
BundleProblem MakeProblem(const KeyFrameData& first, const KeyFrameData& second, const InitialStructure& structure) {
  BundleProblem problem;
  problem.poses.push_back({Rigid3d(), first.camera, true});
  problem.poses.push_back({structure.second_from_first, second.camera, false});
  for (const InitialStructure::Point& point : structure.points) {
    const auto index = static_cast<uint32_t>(problem.points_in_map.size());
    problem.points_in_map.push_back(point.position_in_first);
    AddMeasurement(first, point.first_feature, 0, index, &problem);
    AddMeasurement(second, point.second_feature, 1, index, &problem);
  }
  return problem;
}

/// Takes the problem's solution over and drops the points with an outlier or without depth.
void TakeSolution(const BundleProblem& problem, double chi2, InitialStructure* structure) {
  structure->second_from_first = problem.poses[1].camera_from_map;
  const double baseline = structure->second_from_first.translation.norm();
  std::vector<InitialStructure::Point> kept;
  for (size_t k = 0; k < structure->points.size(); ++k) {
    InitialStructure::Point point = structure->points[k];
    point.position_in_first = problem.points_in_map[k];
    const double first_depth = point.position_in_first.z();
    const double second_depth = (structure->second_from_first * point.position_in_first).z();
    if (!point.position_in_first.allFinite() || !(std::min(first_depth, second_depth) > kMinDepth * baseline)) continue;
    if (NormalizedSquaredError(problem, problem.measurements[2 * k]) > chi2) continue;
    if (NormalizedSquaredError(problem, problem.measurements[2 * k + 1]) > chi2) continue;
    kept.push_back(point);
  }
  structure->points = std::move(kept);
}

Status CheckEnoughPoints(const InitialStructure& structure, const InitializationOptions& options) {
  if (static_cast<int>(structure.points.size()) >= options.min_points) return Ok{};
  return Error{"map initialisation: " + std::to_string(structure.points.size()) +
               " points survive bundle adjustment, expected at least " + std::to_string(options.min_points)};
}

/// Median depth in the first camera becomes 1.
void NormalizeScale(InitialStructure* structure) {
  std::vector<double> depths;
  for (const auto& point : structure->points) depths.push_back(point.position_in_first.z());
  const auto middle = depths.begin() + static_cast<ptrdiff_t>(depths.size() / 2);
  std::nth_element(depths.begin(), middle, depths.end());
  const double scale = 1.0 / *middle;
  structure->second_from_first.translation *= scale;
  for (auto& point : structure->points) point.position_in_first *= scale;
}

}  // namespace

Result<InitialStructure> ReconstructInitialStructure(const KeyFrameData& first, const KeyFrameData& second,
                                                     const FeaturePairs& matches, const InitializationOptions& options,
                                                     const std::optional<Rigid3d>& tracked_second_from_first,
                                                     PlaneWitness* witness) {
  const auto pixels = GatherPixels(first, second, matches);
  if (!pixels.ok()) return pixels.error();
  const bool is_known = tracked_second_from_first && !tracked_second_from_first->translation.isZero(0);
  const auto second_from_first_by_images =
      tracked_second_from_first ? std::optional<Eigen::Quaterniond>(tracked_second_from_first->rotation) : std::nullopt;
  const auto views =
      is_known ? ReconstructByMotion(*pixels, first.camera, second.camera, *tracked_second_from_first, options.two_view)
               : ReconstructTwoViews(*pixels, first.camera, second.camera, options.two_view,
                                     second_from_first_by_images, witness);
  if (!views.ok()) return views.error();

  InitialStructure structure;
  structure.second_from_first = views->second_from_first;
  for (size_t k = 0; k < matches.size(); ++k) {
    if (views->valid[k]) structure.points.push_back({views->points_in_first[k], matches[k].first, matches[k].second});
  }
  BundleOptions bundle;
  bundle.max_iterations = options.bundle_iterations;
  for (const bool robust : {true, false}) {
    if (Status enough = CheckEnoughPoints(structure, options); !enough.ok()) return enough.error();
    NormalizeScale(&structure);
    bundle.robust = robust;
    BundleProblem problem = MakeProblem(first, second, structure);
    const BundleSummary summary = AdjustBundle(&problem, bundle, nullptr);
    if (!summary.converged_or_stopped) return Error{"map initialisation: bundle adjustment failed"};
    TakeSolution(problem, options.chi2, &structure);
  }
  if (Status enough = CheckEnoughPoints(structure, options); !enough.ok()) return enough.error();
  NormalizeScale(&structure);
  return structure;
}

}  // namespace portolan
