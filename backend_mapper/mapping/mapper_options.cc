#include "mapping/mapper_options.h"

#include <string>
#include <vector>

namespace portolan {
namespace {

struct Range {
  const char* name;
  double value, low, high;
};

std::vector<Range> Ranges(const MapperOptions& o) {
  return {
      {"min_landmarks", static_cast<double>(o.min_landmarks), 4, 1e4},
      {"initialization.min_points", static_cast<double>(o.initialization.min_points), 10, 1e4},
      {"initialization.bundle_iterations", static_cast<double>(o.initialization.bundle_iterations), 1, 1000},
      {"creation.neighbours", static_cast<double>(o.creation.neighbours), 1, 100},
      {"creation.min_neighbours", static_cast<double>(o.creation.min_neighbours), 0, 100},
      {"creation.min_baseline", o.creation.min_baseline, 0, 1},
      {"creation.max_distance", static_cast<double>(o.creation.max_distance), 1, 256},
      {"creation.epipolar_chi2", o.creation.epipolar_chi2, 1e-6, 100},
      {"creation.reprojection_chi2", o.creation.reprojection_chi2, 1e-6, 100},
      {"creation.max_parallax_cos", o.creation.max_parallax_cos, 0.5, 1},
      {"creation.max_scale_ratio", o.creation.max_scale_ratio, 1, 100},
      {"creation.min_depth", o.creation.min_depth, 1e-6, 1},
      {"creation.epipole_radius_px", o.creation.epipole_radius_px, 0, 1000},
      {"fusion.neighbours", static_cast<double>(o.fusion.neighbours), 0, 100},
      {"fusion.second_neighbours", static_cast<double>(o.fusion.second_neighbours), 0, 100},
      {"fusion.max_keyframes", static_cast<double>(o.fusion.max_keyframes), 0, 1000},
      {"fusion.chi2", o.fusion.chi2, 1e-6, 100},
      {"fusion.max_distance", static_cast<double>(o.fusion.max_distance), 1, 256},
      {"bundle.max_keyframes", static_cast<double>(o.bundle.max_keyframes), 2, 1000},
      {"bundle.max_fixed", static_cast<double>(o.bundle.max_fixed), 0, 1000},
      {"bundle.min_common", static_cast<double>(o.bundle.min_common), 1, 1e4},
      {"bundle.iterations", static_cast<double>(o.bundle.iterations), 1, 1000},
      {"bundle.chi2", o.bundle.chi2, 1e-6, 100},
      {"lens.first_keyframes", static_cast<double>(o.lens.first_keyframes), 2, 1000},
      {"lens.growth", o.lens.growth, 1.01, 100},
      {"lens.window", static_cast<double>(o.lens.window), 2, 1000},
      {"lens.min_observations", static_cast<double>(o.lens.min_observations), 2, 100},
      {"lens.max_points", static_cast<double>(o.lens.max_points), 1, 1e5},
      {"lens.min_turn_deg", o.lens.min_turn_deg, 0, 180},
      {"lens.max_iterations", static_cast<double>(o.lens.max_iterations), 1, 1000},
      {"pruning.probation_keyframes", static_cast<double>(o.pruning.probation_keyframes), 1, 100},
      {"pruning.probation_observations", static_cast<double>(o.pruning.probation_observations), 2, 100},
      {"pruning.unreliable_visible", static_cast<double>(o.pruning.unreliable_visible), 2, 1000},
      {"pruning.redundant_share", o.pruning.redundant_share, 0.1, 1.01},
      {"pruning.redundant_observers", static_cast<double>(o.pruning.redundant_observers), 1, 100},
      {"pruning.keep_newest", static_cast<double>(o.pruning.keep_newest), 1, 1e6},
      {"pruning.max_checked", static_cast<double>(o.pruning.max_checked), 0, 1000},
  };
}

}  // namespace

Status MapperOptions::Check() const {
  for (const Range& range : Ranges(*this)) {
    if (range.value >= range.low && range.value <= range.high) continue;
    return Error{std::string("mapper option ") + range.name + " is " + std::to_string(range.value) + ", expected " +
                 std::to_string(range.low) + " to " + std::to_string(range.high)};
  }
  return Ok{};
}

}  // namespace portolan
