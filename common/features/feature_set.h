#pragma once

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

namespace portolan {

/// 256 bits of an ORB descriptor as four words; bytes in OpenCV's order (little-endian words).
using Descriptor = std::array<uint64_t, 4>;

/// Number of differing bits, 0 to 256.
inline int HammingDistance(const Descriptor& a, const Descriptor& b) {
  return __builtin_popcountll(a[0] ^ b[0]) + __builtin_popcountll(a[1] ^ b[1]) + __builtin_popcountll(a[2] ^ b[2]) +
         __builtin_popcountll(a[3] ^ b[3]);
}

/// The features of one image, N of them, as parallel arrays. Locations are undistorted pixels of the ideal camera,
/// level 0.
struct FeatureSet {
  std::vector<Eigen::Vector2f> pixels_px;  ///< N, sub-pixel
  std::vector<uint8_t> octaves;            ///< N, pyramid level
  std::vector<float> angles_rad;           ///< N, orientation, 0 to 2 pi, clockwise as y points down
  std::vector<Descriptor> descriptors;     ///< N

  size_t size() const { return pixels_px.size(); }
  /// False where orientations and descriptors were left out: who only follows a keyframe may do without them.
  bool HasAppearance() const { return descriptors.size() == size(); }
};

/// The image pyramid that features come from: 8 levels, factor 1.2 (paper Sec. 7.1).
struct ScalePyramid {
  int levels = 8;
  double factor = 1.2;

  /// Size of one pixel of the level in pixels of level 0: also the standard deviation of a feature's location, in
  /// pixels.
  double Scale(int level) const { return std::pow(factor, level); }
  /// Standard deviation of the location of a feature of the level, in pixels of level 0: one pixel of the level.
  double Sigma(int level) const { return Scale(level); }
  std::vector<double> Sigmas() const { return Scales(); }
  std::vector<double> Scales() const {
    std::vector<double> scales(static_cast<size_t>(levels));
    for (int i = 0; i < levels; ++i) scales[static_cast<size_t>(i)] = Scale(i);
    return scales;
  }
};

}  // namespace portolan
