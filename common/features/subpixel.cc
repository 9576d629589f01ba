#include "features/subpixel.h"

#include <algorithm>
#include <opencv2/core/hal/intrin.hpp>

namespace portolan {
namespace {

constexpr int kCircle = 16;
constexpr int kCircleX[kCircle] = {0, 1, 2, 3, 3, 3, 2, 1, 0, -1, -2, -3, -3, -3, -2, -1};
constexpr int kCircleY[kCircle] = {-3, -3, -2, -1, 0, 1, 2, 3, 3, 3, 2, 1, 0, -1, -2, -3};
constexpr float kMaxOffset = 0.5f;  // measured: looser bounds locate worse

/// Scores s(u, v) for u, v = -1..1, column u + 1, row v + 1.
using Scores = Eigen::Matrix3f;

/// Top of s(u, v) = a + b u + c v + d u^2 + e v^2 + f u v fitted to the nine scores by least squares.
Eigen::Vector2f ParabolaTop(const Scores& s) {
  const Eigen::RowVector3f columns = s.colwise().sum();
  const Eigen::Vector3f rows = s.rowwise().sum();
  const Eigen::Vector2f gradient((columns[2] - columns[0]) / 6, (rows[2] - rows[0]) / 6);
  const float uu = (columns[2] - 2 * columns[1] + columns[0]) / 3, vv = (rows[2] - 2 * rows[1] + rows[0]) / 3;
  const float uv = (s(2, 2) - s(2, 0) - s(0, 2) + s(0, 0)) / 4;
  const float determinant = uu * vv - uv * uv;
  if (uu >= 0 || determinant <= 0) return {0, 0};  // no top
  const Eigen::Vector2f top((uv * gradient.y() - vv * gradient.x()) / determinant,
                            (uv * gradient.x() - uu * gradient.y()) / determinant);
  return top.cwiseMax(-kMaxOffset).cwiseMin(kMaxOffset);
}

}  // namespace

int FastScore(const cv::Mat& level, int x, int y, int sign) {
  const uchar* centre = level.ptr<uchar>(y) + x;
  const auto stride = static_cast<ptrdiff_t>(level.step[0]);
  alignas(16) uchar circle[kCircle];
  for (int i = 0; i < kCircle; ++i) circle[i] = centre[kCircleY[i] * stride + kCircleX[i]];
  const cv::v_uint8x16 ring = cv::v_load_aligned(circle), middle = cv::v_setall_u8(*centre);
  const cv::v_uint8x16 contrast = sign > 0 ? ring - middle : middle - ring;  // saturates at 0
  // Least of 2, 4, 8, 9 neighbours in a row, from each of the sixteen on.
  cv::v_uint8x16 least = cv::v_min(contrast, cv::v_rotate_right<1>(contrast, contrast));
  least = cv::v_min(least, cv::v_rotate_right<2>(least, least));
  least = cv::v_min(least, cv::v_rotate_right<4>(least, least));
  least = cv::v_min(least, cv::v_rotate_right<8>(contrast, contrast));
  return cv::v_reduce_max(least);
}

Eigen::Vector2f SubpixelOffset(const cv::Mat& level, int x, int y) {
  const int brighter = FastScore(level, x, y, +1), darker = FastScore(level, x, y, -1);
  const int sign = brighter > darker ? +1 : -1;
  Scores scores;
  for (int v = -1; v <= 1; ++v) {
    for (int u = -1; u <= 1; ++u) {
      const bool is_centre = u == 0 && v == 0;
      scores(v + 1, u + 1) =
          static_cast<float>(is_centre ? std::max(brighter, darker) : FastScore(level, x + u, y + v, sign));
    }
  }
  return ParabolaTop(scores);
}

}  // namespace portolan
