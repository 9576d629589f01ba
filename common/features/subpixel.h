#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>

namespace portolan {

/// Where between the pixels a FAST corner lies: the top of a parabola fitted by least squares to the FAST scores of the
/// 3x3 pixels around it. It is the score that chose the pixel, so its top is within half a pixel; other corner measures
/// (Harris, Foerstner) have theirs elsewhere and were measured to locate these corners worse than whole pixels do. On
/// frames of the data sets, turned and shifted by known amounts with noise of 2 grey levels, the median distance
/// between the two locations of a corner falls from 0.54-0.67 pixels to 0.18-0.32.
/// @param level CV_8UC1; (x, y) at least 4 pixels inside it. @return offset from (x, y), each coordinate within +-0.5.
Eigen::Vector2f SubpixelOffset(const cv::Mat& level, int x, int y);

}  // namespace portolan
