#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "base/result.h"
#include "geometry/plane_witness.h"
#include "geometry/rigid3.h"
#include "map/keyframe.h"
#include "mapping/mapper_options.h"

namespace portolan {

/// The first structure of a map, in the frame of the first camera; the median depth of its points there is 1.
struct InitialStructure {
  struct Point {
    Eigen::Vector3d position_in_first;
    uint32_t first_feature = 0, second_feature = 0;
  };
  Rigid3d second_from_first;
  std::vector<Point> points;
};

/// Second to last step of map initialisation (paper Sec. 4.1): fundamental matrix or homography in RANSAC, motion,
/// triangulation, BA. BA runs twice, the second time without the outliers of the first. Scale is free in it (the first
/// pose alone is fixed; the solver's damping holds the seventh freedom) and set afterwards.
/// @param matches (feature of first, feature of second).
/// @param tracked_second_from_first what the tracker knows of the motion. Translation 0: the rotation alone, by the
/// images (see ReconstructTwoViews). Else of frames that are tracked in another map, the length of its translation in
/// any unit: beyond the paper, it takes the place of the first steps. On a straight road there is often too little to
/// estimate it.
/// @param witness may be null: what earlier pairs of the same first keyframe told of a plane (see ReconstructTwoViews).
/// Fails with the reason when a feature does not exist, the two views are refused (ReconstructTwoViews) or fewer
/// than options.min_points points survive BA. Deterministic for options.two_view.seed.
Result<InitialStructure> ReconstructInitialStructure(const KeyFrameData& first, const KeyFrameData& second,
                                                     const std::vector<std::pair<uint32_t, uint32_t>>& matches,
                                                     const InitializationOptions& options,
                                                     const std::optional<Rigid3d>& tracked_second_from_first = {},
                                                     PlaneWitness* witness = nullptr);

}  // namespace portolan
