#pragma once

#include <Eigen/Core>
#include <optional>

#include "map/keyframe.h"
#include "map/map_point.h"

namespace portolan {

/// Where and how large a landmark should appear in a keyframe.
struct PredictedFeature {
  Eigen::Vector2d pixel_px;
  double distance = 0;  ///< camera centre to landmark, map units
  int octave = 0;       ///< pyramid level at which it should be detected
};

/// A keyframe as a place to project landmarks into, with what the inner loops need computed once. Keeps a reference to
/// the keyframe.
class KeyFrameView {
 public:
  explicit KeyFrameView(const KeyFrame& keyframe);

  /// @return nothing when the landmark is behind the camera, outside the image, out of the range of distances at which
  /// it can be detected, or seen from more than 60 degrees off its mean viewing direction.
  std::optional<PredictedFeature> Predict(const MapPoint& point) const;

  /// Standard deviation of a feature's location: its pyramid level's scale, pixels.
  double Sigma(uint32_t feature) const { return sigmas_[data().features.octaves[feature]]; }
  double Scale(int octave) const { return scales_[static_cast<size_t>(octave)]; }
  Eigen::Vector2d Pixel(uint32_t feature) const { return data().features.pixels_px[feature].cast<double>(); }
  bool IsFree(uint32_t feature) const { return !keyframe_.landmarks[feature].IsValid(); }

  const KeyFrame& keyframe() const { return keyframe_; }
  const KeyFrameData& data() const { return *keyframe_.data; }
  const PinholeCamera& camera() const { return keyframe_.data->camera; }
  const Eigen::Matrix3d& rotation() const { return rotation_; }  ///< of camera_from_map
  const Eigen::Vector3d& centre_in_map() const { return centre_in_map_; }

 private:
  const KeyFrame& keyframe_;
  Eigen::Matrix3d rotation_;
  Eigen::Vector3d centre_in_map_;
  std::vector<double> scales_, sigmas_;
  double inverse_log_factor_;
};

}  // namespace portolan
