#pragma once

#include <Eigen/Core>
#include <optional>

#include "map/keyframe.h"
#include "map/landmark_projection.h"
#include "map/map_point.h"

namespace portolan {

/// A keyframe as a place to project landmarks into, with what the inner loops need computed once. Keeps a reference to
/// the keyframe.
class KeyFrameView {
 public:
  explicit KeyFrameView(const KeyFrame& keyframe);

  /// Where the keyframe should see the landmark, as LandmarkProjection.
  std::optional<PredictedFeature> Predict(const MapPoint& point) const { return projection_.Predict(point); }

  /// Standard deviation of a feature's location: its pyramid level's scale, pixels.
  double Sigma(uint32_t feature) const { return sigmas_[data().features.octaves[feature]]; }
  double Scale(int octave) const { return scales_[static_cast<size_t>(octave)]; }
  Eigen::Vector2d Pixel(uint32_t feature) const { return data().features.pixels_px[feature].cast<double>(); }
  bool IsFree(uint32_t feature) const { return !keyframe_.landmarks[feature].IsValid(); }

  const KeyFrame& keyframe() const { return keyframe_; }
  const KeyFrameData& data() const { return *keyframe_.data; }
  const PinholeCamera& camera() const { return keyframe_.data->camera; }
  const Eigen::Matrix3d& rotation() const { return projection_.rotation(); }  ///< of camera_from_map
  const Eigen::Vector3d& centre_in_map() const { return projection_.centre_in_map(); }

 private:
  const KeyFrame& keyframe_;
  LandmarkProjection projection_;
  std::vector<double> scales_, sigmas_;
};

}  // namespace portolan
