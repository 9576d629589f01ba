#pragma once

#include <Eigen/Core>
#include <optional>
#include <utility>

#include "geometry/camera_model.h"
#include "geometry/rigid3.h"

namespace portolan {

/// Optimal correction of a match (paper Eq. 10; Hartley and Zisserman, Alg. 12.1, non-iterative): the closest pair of
/// points that meets the epipolar constraint exactly.
/// @param second_from_first fundamental matrix in pixels: x2^T F x1 = 0.
/// @return corrected first and second pixel; the measured ones where the correction is not finite.
std::pair<Eigen::Vector2d, Eigen::Vector2d> CorrectMatch(const Eigen::Matrix3d& second_from_first,
                                                         const Eigen::Vector2d& first_px,
                                                         const Eigen::Vector2d& second_px);

/// F = K2^-T [t]x R K1^-1 of two posed cameras.
Eigen::Matrix3d FundamentalFromMotion(const Rigid3d& second_from_first, const PinholeCamera& first_camera,
                                      const PinholeCamera& second_camera);

/// Direct linear transformation (paper Eq. 11) of one match in normalised coordinates.
/// @param first_from_map, second_from_map camera poses. @param first_xy, second_xy on the plane z = 1.
/// @return the point in the map, or none if it lies at infinity.
std::optional<Eigen::Vector3d> TriangulateDlt(const Rigid3d& first_from_map, const Rigid3d& second_from_map,
                                              const Eigen::Vector2d& first_xy, const Eigen::Vector2d& second_xy);

/// Cosine of the angle between the two rays to a point, seen from the two camera centres.
double ParallaxCosine(const Eigen::Vector3d& first_centre, const Eigen::Vector3d& second_centre,
                      const Eigen::Vector3d& point);

}  // namespace portolan
