#pragma once

#include <Eigen/Core>

#include "geometry/sim3.h"

namespace portolan {

/// How far two similarities may differ and still say the same of a place.
struct PlaceAgreementOptions {
  double max_scale_difference = 0.2;  ///< relative
  double max_rotation_difference_deg = 8;
  double max_distance_difference = 0.2;  ///< of where they put the camera, in its median depths
};

/// Whether two similarities target_from_map put a camera of the map at the same place of the target.
/// @param centre_in_map of the camera. @param median_depth of what it sees, the map's units.
bool Agree(const Sim3d& target_from_map, const Sim3d& other_target_from_map, const Eigen::Vector3d& centre_in_map,
           double median_depth, const PlaceAgreementOptions& options);

}  // namespace portolan
