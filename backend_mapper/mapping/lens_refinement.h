#pragma once

#include <atomic>

#include "geometry/camera_model.h"
#include "map/map.h"
#include "map/protocol.h"
#include "mapping/mapper_options.h"
#include "optimization/bundle_adjustment.h"

namespace portolan {

/// What is looked at: measurements with the known residual still in them.
struct LensProblem {
  PinholeCamera camera;  ///< of the newest keyframe
  BundleProblem bundle;
  RadialResidual known;
};

/// What a map tells of the lens.
struct LensFinding {
  /// Worth taking in, in place of the known one; none if there is nothing new, or nothing certain.
  RadialResidual residual;
  bool is_settled = false;  ///< a larger map will not tell more
};

/// The newest keyframes of a map, and the points that they see longest, as a problem with the newest keyframe fixed:
/// what FindRadialResidual takes. Keyframes of another camera than the newest are passed over.
LensProblem MakeLensProblem(const Map& map, const LensRefinementOptions& options);

/// Beyond the paper: the radial distortion that the camera's calibration left, from the newest keyframes of a young
/// map, by bundle adjustment with a free lens. Published calibrations are often a few pixels off at the rim; features
/// then bend on their way through the image, and in turns the scale drifts. It is worth taking in if it moves features
/// at the rim by options.min_shift_px or more, and explains the map far better than none does and better than another
/// focal length would, with the shift known to options.max_sigma_px. With an exact calibration nothing is. A residual
/// that is known already, from a smaller map, is replaced by the same rules. Takes some 0.2 s. Thread-safe.
LensFinding FindRadialResidual(const LensProblem& problem, const LensRefinementOptions& options);

/// What becomes of a map once a camera's residual is taken out of all its keyframes: global BA over it, as a proposal
/// for LocalMapper::TakeResidual. @param map a copy to work on. `stop` (may be null) ends it early, with the poses as
/// they are. Takes some 0.5 s for a hundred keyframes. Thread-safe.
MapCorrection AdaptToResidual(Map map, const CameraResidual& known, const std::atomic<bool>* stop);

}  // namespace portolan
