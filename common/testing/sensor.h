#pragma once

#include <cstdint>
#include <opencv2/core.hpp>

#include "base/result.h"

namespace portolan {

/// What a camera's sensor adds to the light that falls on it.
struct SensorOptions {
  double noise_sigma = 2.0;      ///< grey levels, gaussian, independent for each pixel and frame
  double exposure_change = 0.0;  ///< amplitude of the slow change of brightness as a factor: 0.2 goes from 0.8 to 1.2
  double exposure_s = 0.0;       ///< open shutter: motion within it blurs; 0 is a perfect shutter

  Status Check() const;
};

/// Turns rendered light into the sensor's picture: exposure, noise, rounding, clipping to 0 to 255.
/// @param light CV_32FC1. @param stamp_s of the frame, for the exposure. @param seed another for each frame: same seed,
/// same noise.
/// @return CV_8UC1.
cv::Mat Expose(const cv::Mat& light, double stamp_s, uint64_t seed, const SensorOptions& options);

}  // namespace portolan
