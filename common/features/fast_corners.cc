#include "features/fast_corners.h"

#include <algorithm>
#include <array>
#include <opencv2/core/hal/intrin.hpp>

#include "base/check.h"

namespace portolan {
namespace {

constexpr int kRadius = FastCorners::kRadius;
constexpr int kCircle = 16;
constexpr int kCircleX[kCircle] = {0, 1, 2, 3, 3, 3, 2, 1, 0, -1, -2, -3, -3, -3, -2, -1};
constexpr int kCircleY[kCircle] = {-3, -3, -2, -1, 0, 1, 2, 3, 3, 3, 2, 1, 0, -1, -2, -3};
constexpr int kLanes = cv::v_uint8x16::nlanes;  // pixels at once

using Pixels = cv::v_uint8x16;

/// Where the circle's pixels are from their centre, in bytes.
using CircleOffsets = std::array<ptrdiff_t, kCircle>;

CircleOffsets OffsetsIn(const cv::Mat& image) {
  CircleOffsets offsets;
  for (size_t i = 0; i < kCircle; ++i) offsets[i] = kCircleY[i] * static_cast<ptrdiff_t>(image.step[0]) + kCircleX[i];
  return offsets;
}

bool IsZero(const Pixels& pixels) {
  return cv::v_signmask(pixels == cv::v_setzero_u8()) == 0xffff;
}

/// The most by which nine in a row of the circle exceed, from their contrasts (saturated at 0). Loops are unrolled so
/// that contrasts stay in registers: twice as fast.
Pixels BestArc(const Pixels (&contrast)[kCircle]) {
  const auto at = [&](int i) -> const Pixels& { return contrast[i % kCircle]; };
  // Least of 2, 4, 8 from each odd place on; the ninth is the neighbour on either side.
  Pixels least[kCircle / 2], least_of_4[kCircle / 2];
#pragma GCC unroll 16
  for (int k = 0; k < kCircle / 2; ++k) least[k] = cv::v_min(at(2 * k + 1), at(2 * k + 2));
#pragma GCC unroll 16
  for (int k = 0; k < kCircle / 2; ++k) least_of_4[k] = cv::v_min(least[k], least[(k + 1) % (kCircle / 2)]);
  Pixels best = cv::v_setzero_u8();
#pragma GCC unroll 16
  for (int k = 0; k < kCircle / 2; ++k) {
    const Pixels least_of_8 = cv::v_min(least_of_4[k], least_of_4[(k + 2) % (kCircle / 2)]);
    best = cv::v_max(best, cv::v_min(least_of_8, cv::v_max(at(2 * k), at(2 * k + 9))));
  }
  return best;
}

/// Scores of sixteen pixels, 0 for those that are no corners at the threshold.
Pixels ScoresAbove(const Pixels& threshold, const uchar* centre, const CircleOffsets& offsets) {
  const Pixels middle = cv::v_load(centre), high = middle + threshold, low = middle - threshold;
  // Nine in a row have one of each pair of opposite pixels: most of a picture is done with after four pairs.
  Pixels brighter = cv::v_setall_u8(255), darker = brighter;  // by how much more than the threshold, at most
#pragma GCC unroll 4
  for (size_t i = 0; i < kCircle / 2; i += 2) {
    const Pixels a = cv::v_load(centre + offsets[i]), b = cv::v_load(centre + offsets[i + kCircle / 2]);
    brighter = cv::v_min(brighter, cv::v_max(a, b) - high);
    darker = cv::v_min(darker, low - cv::v_min(a, b));
  }
  if (IsZero(brighter | darker)) return cv::v_setzero_u8();
  Pixels contrast[kCircle];
#pragma GCC unroll 16
  for (size_t i = 0; i < kCircle; ++i) contrast[i] = cv::v_load(centre + offsets[i]) - middle;
  Pixels score = BestArc(contrast);
#pragma GCC unroll 16
  for (size_t i = 0; i < kCircle; ++i) contrast[i] = middle - cv::v_load(centre + offsets[i]);
  score = cv::v_max(score, BestArc(contrast));
  // By one less than the score it is still a corner: what is compared must be exceeded.
  return (score > threshold) & (score - cv::v_setall_u8(1));
}

void ScoreRow(const cv::Mat& image, int y, int threshold, const CircleOffsets& offsets, std::vector<uint8_t>* scores) {
  const int end = image.cols - kRadius;
  if (end - kRadius >= kLanes) {
    const uchar* row = image.ptr<uchar>(y);
    const Pixels least = cv::v_setall_u8(static_cast<uchar>(threshold));
    for (int x = kRadius; x < end; x += kLanes) {
      const int first = std::min(x, end - kLanes);  // the last sixteen may have been looked at before
      cv::v_store(&(*scores)[static_cast<size_t>(first)], ScoresAbove(least, row + first, offsets));
    }
    return;
  }
  for (int x = kRadius; x < end; ++x) {
    const int score = std::max(FastScore(image, x, y, +1), FastScore(image, x, y, -1));
    (*scores)[static_cast<size_t>(x)] = static_cast<uint8_t>(score > threshold ? score - 1 : 0);
  }
}

/// Appends what is stronger than all of its neighbours in the row and the rows above and below.
void TakeStrongest(const uint8_t* above, const uint8_t* row, const uint8_t* below, int y, int columns,
                   std::vector<Corner>* corners) {
  for (int x = kRadius; x < columns - kRadius; x += kLanes) {
    const Pixels scores = cv::v_load(row + x);
    if (IsZero(scores)) continue;
    Pixels around = cv::v_max(cv::v_load(row + x - 1), cv::v_load(row + x + 1));
    for (const uint8_t* other : {above, below}) {
      around = cv::v_max(
          around, cv::v_max(cv::v_load(other + x), cv::v_max(cv::v_load(other + x - 1), cv::v_load(other + x + 1))));
    }
    for (int strongest = cv::v_signmask(scores > around); strongest != 0; strongest &= strongest - 1) {
      const int at = x + __builtin_ctz(static_cast<unsigned>(strongest));
      corners->push_back({at, y, static_cast<float>(row[at])});
    }
  }
}

}  // namespace

void FastCorners::Find(const cv::Mat& image, int threshold, std::vector<Corner>* corners) {
  PORTOLAN_CHECK(image.type() == CV_8UC1) << "type " << image.type();
  PORTOLAN_CHECK(threshold >= 1 && threshold <= 254) << threshold;
  if (image.cols <= 2 * kRadius || image.rows <= 2 * kRadius) return;
  const CircleOffsets offsets = OffsetsIn(image);
  // Rows are read in whole registers, with a neighbour on either side.
  for (std::vector<uint8_t>& row : rows_) row.assign(static_cast<size_t>(image.cols + 2 * kLanes), 0);
  std::vector<uint8_t>*above = &rows_[0], *row = &rows_[1], *below = &rows_[2];
  const int last = image.rows - kRadius - 1;
  for (int y = kRadius; y <= last + 1; ++y) {
    if (y <= last)
      ScoreRow(image, y, threshold, offsets, below);
    else
      std::fill(below->begin(), below->end(), 0);
    if (y > kRadius) TakeStrongest(above->data(), row->data(), below->data(), y - 1, image.cols, corners);
    std::vector<uint8_t>* const free = above;
    above = row;
    row = below;
    below = free;
  }
}

int FastScore(const cv::Mat& level, int x, int y, int sign) {
  const uchar* centre = level.ptr<uchar>(y) + x;
  const auto stride = static_cast<ptrdiff_t>(level.step[0]);
  alignas(16) uchar circle[kCircle];
  for (int i = 0; i < kCircle; ++i) circle[i] = centre[kCircleY[i] * stride + kCircleX[i]];
  const Pixels ring = cv::v_load_aligned(circle), middle = cv::v_setall_u8(*centre);
  const Pixels contrast = sign > 0 ? ring - middle : middle - ring;  // saturates at 0
  // Least of 2, 4, 8, 9 neighbours in a row, from each of the sixteen on.
  Pixels least = cv::v_min(contrast, cv::v_rotate_right<1>(contrast, contrast));
  least = cv::v_min(least, cv::v_rotate_right<2>(least, least));
  least = cv::v_min(least, cv::v_rotate_right<4>(least, least));
  least = cv::v_min(least, cv::v_rotate_right<8>(contrast, contrast));
  return cv::v_reduce_max(least);
}

}  // namespace portolan
