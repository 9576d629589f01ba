#include "features/subpixel.h"

#include <algorithm>

#include "features/fast_corners.h"

namespace portolan {
namespace {

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
