#pragma once

#include <Eigen/Core>
#include <vector>

#include "base/result.h"
#include "geometry/sim3.h"

namespace portolan {

/// The similarity that minimises sum |b_i - b_from_a * a_i|^2 (Horn 1987 / Umeyama 1991; paper Sec. 5).
/// @param fix_scale keeps scale 1 (rigid alignment). Fails with fewer than 3 points or collinear ones.
Result<Sim3d> AlignPoints(const std::vector<Eigen::Vector3d>& points_in_a,
                          const std::vector<Eigen::Vector3d>& points_in_b, bool fix_scale = false);

}  // namespace portolan
