#include "geometry/plane_witness.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace portolan {
namespace {

// A wall's true normals lie within 5 degrees with 100 matches, and within half a degree with 600 (portolan_synth wall),
// where the twin's turned by 60. Twice the limit tells them apart.
constexpr double kSame = 7 * M_PI / 180, kOther = 14 * M_PI / 180;

}  // namespace

double PlaneWitness::FarthestFrom(const Eigen::Vector3d& normal) const {
  double farthest = 0;
  for (const std::vector<PlanarMotion>& pair : pairs_) {
    double nearest = std::numeric_limits<double>::infinity();
    for (const PlanarMotion& motion : pair) {
      const Eigen::Vector3d& other = motion.normal_in_first;
      nearest = std::min(nearest, std::atan2(normal.cross(other).norm(), normal.dot(other)));
    }
    farthest = std::max(farthest, nearest);
  }
  return farthest;
}

std::optional<size_t> PlaneWitness::Judge(const std::vector<PlanarMotion>& motions) const {
  if (pairs_.size() < kMinPairs) return std::nullopt;
  std::optional<size_t> allowed;
  for (size_t i = 0; i < motions.size(); ++i) {
    const double farthest = FarthestFrom(motions[i].normal_in_first);
    if (farthest > kOther) continue;
    if (farthest > kSame || allowed) return std::nullopt;
    allowed = i;
  }
  return allowed;
}

void PlaneWitness::Add(const std::vector<PlanarMotion>& motions) {
  if (motions.size() >= 2 && pairs_.size() < kMaxPairs) pairs_.push_back(motions);
}

}  // namespace portolan
