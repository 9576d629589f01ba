#pragma once

#include <cstdint>

#include "features/feature_set.h"
#include "geometry/camera_model.h"

namespace portolan {

// How feature locations and orientations travel: as 16-bit steps. The tracker rounds its features to steps before it
// uses them, so that every process computes with the same bits.

/// Steps to the pixel: 32, which is within 1/64 px (a tenth of the sub-pixel noise of a corner), or the largest power
/// of two below it with which the larger side of the image fits into 16 bits. @param camera with sides up to
/// kMaxImageSide.
int StepsPerPixel(const PinholeCamera& camera);

/// Nearest step of a coordinate inside the image.
uint16_t PixelToSteps(float coordinate_px, int steps_per_pixel);
float StepsToPixel(uint16_t steps, int steps_per_pixel);

/// Nearest of 65536 steps to the turn; any finite angle, taken modulo a turn.
uint16_t AngleToSteps(float angle_rad);
/// In [0, 2 pi).
float StepsToAngle(uint16_t steps);

/// Rounds locations and angles to what the wire carries. Idempotent; a message's way over the wire changes nothing
/// afterwards.
/// @param features with all locations inside the camera's image.
void QuantizeFeatures(FeatureSet* features, const PinholeCamera& camera);

}  // namespace portolan
