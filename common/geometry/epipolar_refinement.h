#pragma once

#include <Eigen/Core>
#include <vector>

#include "geometry/rigid3.h"

namespace portolan {

/// Refines the motion between two calibrated views on all matches at once: Levenberg-Marquardt on the sum of squared
/// Sampson distances (Hartley and Zisserman, Eq. 11.9), each truncated at max_distance, over the five degrees of
/// freedom of E = [t]x R. Truncation keeps outliers from pulling; the start must be close enough for most inliers to be
/// inside.
/// @param first_xy, second_xy N, on the plane z = 1. @param max_distance on the plane z = 1.
/// @return a motion with translation of length 1 and a cost no higher than the start's.
Rigid3d RefineMotion(const Rigid3d& second_from_first, const std::vector<Eigen::Vector2d>& first_xy,
                     const std::vector<Eigen::Vector2d>& second_xy, double max_distance);

/// Signed Sampson distance of a match from E = [t]x R, and its gradient where wanted: first the translation's change
/// along TangentBasis(t), then a rotation vector applied on the left of R.
double SampsonDistance(const Rigid3d& second_from_first, const Eigen::Vector2d& first_xy,
                       const Eigen::Vector2d& second_xy, Eigen::Matrix<double, 5, 1>* gradient);

/// Two orthonormal directions perpendicular to a unit vector.
Eigen::Matrix<double, 3, 2> TangentBasis(const Eigen::Vector3d& unit);

/// The motion moved by a step in the order of SampsonDistance's gradient; its translation keeps length 1.
Rigid3d MoveOnEssentialManifold(const Rigid3d& second_from_first, const Eigen::Matrix<double, 5, 1>& step);

}  // namespace portolan
