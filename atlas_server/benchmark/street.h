#pragma once

#include "testing/synthetic_scene.h"

// The place that the benchmarks share.

namespace portolan {

/// A lap in a street of its own, or another one in the same: houses, and some 2000 features an image, as real ones
/// have.
/// @param number of the street. @param size in views of a lap that is driven for the first time. @param views of this
/// lap.
inline SyntheticScene MakeStreet(int number, int size, int views, uint32_t session) {
  SyntheticSceneOptions options;
  options.landmarks = LandmarkLayout::kStreet;
  options.motion = CameraMotion::kStreetLap;
  options.lap = 0.2 * size;
  options.num_landmarks = 40 * size;
  options.num_views = views;
  options.travel = options.lap * 0.95;
  options.sight = 12;
  options.pixel_sigma_px = 0.5;
  options.descriptor_flip_ratio = 0.03;
  options.num_clutter = 1400;
  options.seed = static_cast<uint64_t>(number + 1);
  options.session = session;
  return MakeSyntheticScene(options);
}

}  // namespace portolan
