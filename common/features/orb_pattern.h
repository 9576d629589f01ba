#pragma once

#include <array>
#include <cstdint>

namespace portolan {

/// One bit of an ORB descriptor: set where the smoothed image is darker at (x1, y1) than at (x2, y2). Pixels relative
/// to the corner, in its frame of orientation.
struct OrbPatternPair {
  int8_t x1, y1, x2, y2;
};

/// Pixels from a corner to the farthest sample of the pattern under any rotation and rounding: sqrt(13^2 + 13^2)
/// rounded up.
constexpr int kOrbPatternReach = 19;

/// The 256 pairs that Rublee et al. learned (ORB, ICCV 2011), bit by bit: the figures of OpenCV's cv::ORB (Apache-2.0),
/// so that descriptors agree with it and vocabularies of other ORB systems can be read.
extern const std::array<OrbPatternPair, 256> kOrbPattern;

}  // namespace portolan
