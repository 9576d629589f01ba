#pragma once

#include <vector>

#include "features/feature_matcher.h"
#include "map/keyframe_view.h"
#include "mapping/mapper_options.h"

namespace portolan {

/// Matches features that are no landmarks yet along epipolar lines (paper Sec. 4.2): for each free feature of `first`,
/// the free feature of `second` with the least Hamming distance among those that lie on the image of its ray, between
/// infinity and the depth min_depth. One to one (the closer descriptor wins), orientations consistent. Matches around
/// the epipole are left out: there the line has no direction.
/// @param min_depth nearest depth in the first camera, map units.
/// The cameras must not share a centre. Deterministic.
std::vector<FeatureMatch> SearchEpipolar(const KeyFrameView& first, const KeyFrameView& second, double min_depth,
                                         const PointCreationOptions& options);

}  // namespace portolan
