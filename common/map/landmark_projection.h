#pragma once

#include <Eigen/Core>
#include <optional>

#include "features/feature_set.h"
#include "geometry/camera_model.h"
#include "geometry/rigid3.h"
#include "map/map_point.h"

namespace portolan {

/// Where and how large a landmark should appear in an image.
struct PredictedFeature {
  Eigen::Vector2d pixel_px;
  double distance = 0;        ///< camera centre to landmark, map units
  int octave = 0;             ///< pyramid level at which it should be detected
  double viewing_cosine = 0;  ///< of the angle to the landmark's mean viewing direction
};

/// Predicts which landmarks of a map a camera sees, and how. Keeps references to the camera and the pyramid.
class LandmarkProjection {
 public:
  LandmarkProjection(const PinholeCamera& camera, const ScalePyramid& pyramid, const Rigid3d& camera_from_map);

  /// @return nothing when the landmark is behind the camera, outside the image, out of the range of distances at which
  /// it can be detected, or seen from more than 60 degrees off its mean viewing direction. Its derived fields must be
  /// up to date.
  std::optional<PredictedFeature> Predict(const MapPoint& point) const;

  const Eigen::Matrix3d& rotation() const { return rotation_; }  ///< of camera_from_map
  const Eigen::Vector3d& centre_in_map() const { return centre_in_map_; }

 private:
  const PinholeCamera& camera_;
  const ScalePyramid& pyramid_;
  Eigen::Matrix3d rotation_;
  Eigen::Vector3d centre_in_map_;
  double inverse_log_factor_;
};

}  // namespace portolan
