#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <vector>

#include "base/ids.h"
#include "map/keyframe_view.h"
#include "map/map.h"
#include "mapping/mapper_options.h"

namespace portolan {

/// Triangulates matches between two posed keyframes (paper Sec. 4.2).
class MatchTriangulator {
 public:
  /// The views must outlive it.
  MatchTriangulator(const KeyFrameView& first, const KeyFrameView& second, const PointCreationOptions& options);

  /// Corrects the match (paper Eq. 10), solves by DLT (Eq. 11) and checks parallax, sign of both depths, both
  /// reprojection errors and the consistency of distances with octaves. @return the point in the map, none when a check
  /// fails.
  std::optional<Eigen::Vector3d> Triangulate(uint32_t first_feature, uint32_t second_feature) const;

 private:
  bool HasParallax(const Eigen::Vector2d& first_px, const Eigen::Vector2d& second_px) const;
  bool Reprojects(const KeyFrameView& view, uint32_t feature, const Eigen::Vector3d& point_in_map) const;
  bool IsScaleConsistent(uint32_t first_feature, uint32_t second_feature, const Eigen::Vector3d& point_in_map) const;

  const KeyFrameView& first_;
  const KeyFrameView& second_;
  const PointCreationOptions& options_;
  Eigen::Matrix3d fundamental_;
};

/// Makes landmarks of the features that two keyframes of the map see and that are none yet: epipolar search and
/// triangulation. Each gets its two observations. @param mint makes ids. @return the new points, in order of creation;
/// none when the baseline is below options.min_baseline of the second keyframe's median depth, or neither keyframe sees
/// landmarks.
std::vector<MapPointId> CreatePoints(Map* map, KeyFrameId first, KeyFrameId second, const PointCreationOptions& options,
                                     IdMinter<MapPointId>* mint);

}  // namespace portolan
