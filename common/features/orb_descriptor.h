#pragma once

#include <opencv2/core.hpp>

#include "features/feature_set.h"

namespace portolan {

/// Radius of the patch that gives a corner its orientation, pixels of the level (Rublee et al.: patches of 31 pixels).
constexpr int kOrbPatchRadius = 15;

/// Distance that corners keep from the border of their level, pixels: the pattern and the patch fit inside.
constexpr int kOrbBorder = 19;

/// Direction from the corner to the centre of intensity of the circular patch around it.
/// Source: Rublee et al., ORB, ICCV 2011, Sec. 3.2: atan2(m01, m10).
/// @param level CV_8UC1; (x, y) at least kOrbBorder pixels inside it. @return radians in [0, 2 pi), clockwise as y
/// points down.
float OrbAngle(const cv::Mat& level, int x, int y);

/// The rotated BRIEF descriptor of a corner, equal to OpenCV's.
/// Source: Rublee et al., ORB, ICCV 2011, Sec. 4.
/// @param smoothed CV_8UC1, the level after SmoothForOrb; (x, y) at least kOrbBorder pixels inside it.
Descriptor OrbDescriptor(const cv::Mat& smoothed, int x, int y, float angle_rad);

/// Smooths a level as descriptors need it: Gaussian of 7x7 pixels, sigma 2 (the figures of cv::ORB).
void SmoothForOrb(const cv::Mat& level, cv::Mat* smoothed);

}  // namespace portolan
