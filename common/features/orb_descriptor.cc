#include "features/orb_descriptor.h"

#include <cmath>
#include <cstring>
#include <opencv2/core/hal/intrin.hpp>
#include <opencv2/imgproc.hpp>

#include "features/orb_pattern.h"

namespace portolan {
namespace {

constexpr int kPatchRows = 2 * kOrbPatchRadius + 1;
constexpr int kPatchColumns = 32;  // a row's 31 pixels and one of weight 0: whole vector registers
constexpr int kSamples = 512;

/// Weights of a patch's pixels in the moments m10 and m00, a row per v = -15..15, zero outside of the circle.
struct PatchWeights {
  PatchWeights() {
    for (int row = 0; row < kPatchRows; ++row) {
      const int v = row - kOrbPatchRadius;
      for (int column = 0; column < kPatchColumns; ++column) {
        const int u = column - kOrbPatchRadius;
        const bool inside = std::hypot(u, v) < kOrbPatchRadius + 0.5;
        m10[row][column] = static_cast<int16_t>(inside ? u : 0);
        m00[row][column] = static_cast<int16_t>(inside ? 1 : 0);
      }
    }
  }
  int16_t m10[kPatchRows][kPatchColumns];
  int16_t m00[kPatchRows][kPatchColumns];
};

/// The pattern as coordinates for vector arithmetic: first points of the 256 pairs, then second points.
struct PatternSamples {
  PatternSamples() {
    for (int i = 0; i < 256; ++i) {
      const OrbPatternPair& pair = kOrbPattern[static_cast<size_t>(i)];
      x[i] = pair.x1;
      y[i] = pair.y1;
      x[i + 256] = pair.x2;
      y[i + 256] = pair.y2;
    }
  }
  float x[kSamples];
  float y[kSamples];
};

/// The bits of value + 1.5 * 2^23, whose low part is the value rounded to the nearest integer (halves to even, as
/// cvRound).
inline uint32_t RoundedBits(float value) {
  const float shifted = value + 12582912.0f;
  uint32_t bits;
  std::memcpy(&bits, &shifted, sizeof bits);
  return bits;
}

}  // namespace

float OrbAngle(const cv::Mat& level, int x, int y) {
  static const PatchWeights kWeights;
  int m10 = 0, m01 = 0;
  for (int row = 0; row < kPatchRows; ++row) {
    const uchar* pixels = level.ptr<uchar>(y + row - kOrbPatchRadius) + x - kOrbPatchRadius;
    int row_m10 = 0, row_m00 = 0;
    for (int column = 0; column < kPatchColumns; ++column) {
      row_m10 += kWeights.m10[row][column] * pixels[column];
      row_m00 += kWeights.m00[row][column] * pixels[column];
    }
    m10 += row_m10;
    m01 += (row - kOrbPatchRadius) * row_m00;
  }
  const float angle = std::atan2(static_cast<float>(m01), static_cast<float>(m10));
  return angle < 0 ? angle + static_cast<float>(2 * M_PI) : angle;
}

Descriptor OrbDescriptor(const cv::Mat& smoothed, int x, int y, float angle_rad) {
  static const PatternSamples kPattern;
  const float cosine = std::cos(angle_rad), sine = std::sin(angle_rad);
  const uint32_t stride = static_cast<uint32_t>(smoothed.step[0]);
  const uint32_t zero = RoundedBits(0.0f) * stride + RoundedBits(0.0f);
  int32_t offsets[kSamples];
  for (int i = 0; i < kSamples; ++i) {
    const float rotated_x = kPattern.x[i] * cosine - kPattern.y[i] * sine;
    const float rotated_y = kPattern.x[i] * sine + kPattern.y[i] * cosine;
    offsets[i] = static_cast<int32_t>(RoundedBits(rotated_y) * stride + RoundedBits(rotated_x) - zero);
  }
  const uchar* centre = smoothed.ptr<uchar>(y) + x;
  uchar samples[kSamples];
  for (int i = 0; i < kSamples; ++i) samples[i] = centre[offsets[i]];
  Descriptor descriptor{};
  for (int i = 0; i < 256; i += 16) {
    const cv::v_uint8x16 is_darker = cv::v_load(samples + i) < cv::v_load(samples + 256 + i);
    descriptor[static_cast<size_t>(i) / 64] |= static_cast<uint64_t>(cv::v_signmask(is_darker)) << (i % 64);
  }
  return descriptor;
}

void SmoothForOrb(const cv::Mat& level, cv::Mat* smoothed) {
  static const cv::Mat kKernel = cv::getGaussianKernel(7, 2, CV_32F);
  cv::sepFilter2D(level, *smoothed, CV_8U, kKernel, kKernel, cv::Point(-1, -1), 0, cv::BORDER_REFLECT_101);
}

}  // namespace portolan
