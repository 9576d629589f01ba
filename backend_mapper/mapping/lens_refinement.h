#pragma once

#include <atomic>
#include <optional>

#include "geometry/camera_model.h"
#include "map/map.h"
#include "mapping/mapper_options.h"

namespace portolan {

/// Beyond the paper: the radial distortion that the camera's calibration left, from a young map, by bundle adjustment with a free lens. Published calibrations are
/// often a few pixels off at the rim; features then bend on their way through the image, and in turns the scale drifts.
/// @return the distortion if it is worth taking in: it moves features at the rim by options.min_shift_px or more, and explains the map far better than
/// none does. None otherwise, as with an exact calibration.
std::optional<RadialResidual> FindRadialResidual(const Map& map, const LensRefinementOptions& options, const std::atomic<bool>* stop);

}  // namespace portolan
