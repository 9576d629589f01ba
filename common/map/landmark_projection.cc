#include "map/landmark_projection.h"

#include <algorithm>
#include <cmath>

namespace portolan {
namespace {

// A descriptor stays recognisable up to about this angle off the direction it was seen from.
constexpr double kMinViewingCosine = 0.5;
// Slack of the range of distances: a detector still fires a bit beyond the nominal size (one pyramid level).
constexpr double kDistanceSlack = 1.2;

}  // namespace

LandmarkProjection::LandmarkProjection(const PinholeCamera& camera, const ScalePyramid& pyramid,
                                       const Rigid3d& camera_from_map)
    : camera_(camera),
      pyramid_(pyramid),
      rotation_(camera_from_map.rotation.toRotationMatrix()),
      centre_in_map_(camera_from_map.TargetOriginInSource()),
      inverse_log_factor_(1.0 / std::log(pyramid.factor)) {}

std::optional<PredictedFeature> LandmarkProjection::Predict(const MapPoint& point) const {
  const Eigen::Vector3d from_centre = point.position_in_map.cast<double>() - centre_in_map_;
  const Eigen::Vector3d in_camera = rotation_ * from_centre;
  if (!(in_camera.z() > 0)) return std::nullopt;
  PredictedFeature predicted;
  predicted.pixel_px = camera_.Project(in_camera);
  if (!camera_.Contains(predicted.pixel_px)) return std::nullopt;
  predicted.distance = from_centre.norm();
  if (predicted.distance * kDistanceSlack < point.min_distance ||
      predicted.distance > point.max_distance * kDistanceSlack) {
    return std::nullopt;
  }
  const double along_mean = from_centre.dot(point.mean_viewing_direction.cast<double>());
  if (along_mean < kMinViewingCosine * predicted.distance) return std::nullopt;
  predicted.viewing_cosine = along_mean / predicted.distance;
  // At max_distance it shows at octave 0; each octave nearer it is larger by the pyramid's factor.
  const double octave = std::log(point.max_distance / predicted.distance) * inverse_log_factor_;
  predicted.octave = std::clamp(static_cast<int>(std::lround(octave)), 0, pyramid_.levels - 1);
  return predicted;
}

}  // namespace portolan
