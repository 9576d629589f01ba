#pragma once

#include <opencv2/core.hpp>

#include "base/random.h"

// Procedural pictures with corners at many scales, no two alike for different random states. All are CV_8UC1 and of the
// side or size asked for; deterministic for the state of `random`.

namespace portolan {

/// Cloudy noise: octaves of smoothed random grids, halving in size. @param coarsest_px cell of the coarsest. Mean
/// `mean`, deviations up to about `amplitude` grey levels.
cv::Mat PaintNoise(cv::Size size, double mean, double amplitude, int coarsest_px, Random* random);

/// Rows of bricks in running bond with joints, each brick of its own tone.
cv::Mat PaintBricks(int side, int rows, double tone, Random* random);
/// Roundish stones of differing tone and size in dark joints, without seams at the picture's sides.
cv::Mat PaintCobbles(int side, int rows, Random* random);
/// Slabs of pavement with stains and cracks.
cv::Mat PaintPavement(int side, int slabs, Random* random);
/// Boards with grain and joints.
cv::Mat PaintPlanks(int side, int boards, Random* random);
/// A print: fields, discs, stripes and lines of letter-like marks.
cv::Mat PaintPoster(cv::Size size, Random* random);
/// Shelves full of books of differing width, height and back.
cv::Mat PaintBookshelf(int side, int shelves, Random* random);
/// A house front: a wall material, rows of windows, doors, a shop with a sign, posters, pipes and stains.
cv::Mat PaintFacade(int side, int storeys, Random* random);
/// The plastered wall of a room, with pictures, notes, sockets and stains.
cv::Mat PaintRoomWall(cv::Size size, Random* random);

/// Fills a field with marks like a line of text: strokes on a coarse grid, unlike any other's.
void PaintLettering(cv::Mat* picture, const cv::Rect& field, double ink, Random* random);

}  // namespace portolan
