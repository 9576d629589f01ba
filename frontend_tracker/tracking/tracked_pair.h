#pragma once

#include <optional>

#include "map/map.h"
#include "tracking/frame.h"
#include "tracking/initializer.h"
#include "tracking/tracker_options.h"

namespace portolan {

/// The two frames of a new map, from two that are tracked in the same old one (paper Sec. 3.4): their motion and the
/// depth of what they see are known, which takes the place of the two-view estimate, and makes a map also of a straight
/// way ahead. Matches are the landmarks that both see, and features near where the depth of the landmarks around them
/// puts them.
/// @return none with fewer than options.min_matches matches.
std::optional<Initializer::Pair> MakeTrackedPair(const Map& map, const Frame& first, const Frame& second,
                                                 const InitializerOptions& options);

}  // namespace portolan
