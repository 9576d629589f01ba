#pragma once

#include <cstdint>
#include <vector>

#include "features/corner_detection.h"

namespace portolan {

/// Thins corners out to `count`, evenly over the image: square cells as large as will still leave `count` of them
/// occupied keep their strongest corner each, and the weakest of those go if they are too many. So crowded places lose
/// corners before sparse ones do.
/// @param corners within width x height pixels. @param count wanted.
/// @return indices into `corners`, at most `count`, ascending; all of them if there are no more. Deterministic.
std::vector<uint32_t> SpreadCorners(const std::vector<Corner>& corners, int width, int height, int count);

}  // namespace portolan
