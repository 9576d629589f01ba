#include "map/keyframe_view.h"

#include <algorithm>
#include <cmath>

namespace portolan {
namespace {

// A descriptor stays recognisable up to about this angle off the direction it was seen from.
constexpr double kMinViewingCosine = 0.5;
// Slack of the range of distances: a detector still fires a bit beyond the nominal size (one pyramid level).
constexpr double kDistanceSlack = 1.2;

}  // namespace

KeyFrameView::KeyFrameView(const KeyFrame& keyframe)
    : keyframe_(keyframe),
      rotation_(keyframe.camera_from_map.rotation.toRotationMatrix()),
      centre_in_map_(keyframe.camera_from_map.TargetOriginInSource()),
      scales_(keyframe.data->pyramid.Scales()),
      sigmas_(keyframe.data->pyramid.Sigmas()),
      inverse_log_factor_(1.0 / std::log(keyframe.data->pyramid.factor)) {}

std::optional<PredictedFeature> KeyFrameView::Predict(const MapPoint& point) const {
  const Eigen::Vector3d from_centre = point.position_in_map.cast<double>() - centre_in_map_;
  const Eigen::Vector3d in_camera = rotation_ * from_centre;
  if (!(in_camera.z() > 0)) return std::nullopt;
  PredictedFeature predicted;
  predicted.pixel_px = camera().Project(in_camera);
  if (!camera().Contains(predicted.pixel_px)) return std::nullopt;
  predicted.distance = from_centre.norm();
  if (predicted.distance * kDistanceSlack < point.min_distance ||
      predicted.distance > point.max_distance * kDistanceSlack) {
    return std::nullopt;
  }
  if (from_centre.dot(point.mean_viewing_direction.cast<double>()) < kMinViewingCosine * predicted.distance)
    return std::nullopt;
  // At max_distance it shows at octave 0; each octave nearer it is larger by the pyramid's factor.
  const double octave = std::log(point.max_distance / predicted.distance) * inverse_log_factor_;
  predicted.octave = std::clamp(static_cast<int>(std::lround(octave)), 0, data().pyramid.levels - 1);
  return predicted;
}

}  // namespace portolan
