#pragma once

#include <opencv2/core.hpp>

#include "geometry/camera_model.h"

namespace portolan {

/// Turns ideal pictures into those of a lens with radial distortion, by resampling: to render what a calibration does
/// not tell of.
///
///   LensWarp warp(camera, lens);
///   Renderer renderer(world, warp.ideal_camera());
///   cv::Mat grey = warp.Apply(renderer.Render(world_from_camera));
class LensWarp {
 public:
  /// Whether every pixel of the image has an ideal one, at most a quarter of the image's width away.
  static bool IsPossible(const PinholeCamera& camera, const RadialResidual& lens);

  /// @param camera of the pictures to make. @param lens must be possible.
  LensWarp(const PinholeCamera& camera, const RadialResidual& lens);

  /// Of the pictures to warp: the same rays, with a border where the lens sees farther than the camera without it.
  const PinholeCamera& ideal_camera() const { return ideal_camera_; }
  /// @param light CV_32FC1 as of ideal_camera(). @return CV_32FC1 of the camera's size.
  cv::Mat Apply(const cv::Mat& light) const;

 private:
  PinholeCamera ideal_camera_;
  cv::Mat map_px_;  // CV_32FC2: where in the ideal picture each pixel comes from
};

}  // namespace portolan
