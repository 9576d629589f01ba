#include "place_recognition/place_agreement.h"

#include <cmath>

namespace portolan {

bool Agree(const Sim3d& a, const Sim3d& b, const Eigen::Vector3d& centre_in_map, double median_depth,
           const PlaceAgreementOptions& options) {
  const Sim3d a_from_b = a * b.Inverse();
  if (std::abs(std::log(a_from_b.scale)) > std::log1p(options.max_scale_difference)) return false;
  const double degrees = a_from_b.rotation.angularDistance(Eigen::Quaterniond::Identity()) * 180 / M_PI;
  if (degrees > options.max_rotation_difference_deg) return false;
  const double apart = (a * centre_in_map - b * centre_in_map).norm();
  return apart <= options.max_distance_difference * a.scale * median_depth;
}

}  // namespace portolan
