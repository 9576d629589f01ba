#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "geometry/rigid3.h"

namespace portolan {

/// One way in which two calibrated views may show a plane.
struct PlanarMotion {
  Rigid3d second_from_first;        ///< translation of length 1
  Eigen::Vector3d normal_in_first;  ///< of the plane, of length 1; points on it that are seen lie on its side
};

/// Tells the true one of the two motions that two views of a plane have nearly always (Longuet-Higgins 1986; Ma et al.,
/// An Invitation to 3-D Vision, Sec. 5.3.3). In the wrong one the plane's normal and the direction of translation have
/// changed places. Seen from one first view, the true normal stays where it was while the camera goes on in another
/// direction, and the wrong one turns with it.
///
///   PlaneWitness witness;                       // of one first view
///   if (const auto i = witness.Judge(motions)) Use(motions[*i]);
///   witness.Add(motions);
class PlaneWitness {
 public:
  /// @return which of two or more motions is the only one whose normal all earlier pairs allow; none while it is open.
  std::optional<size_t> Judge(const std::vector<PlanarMotion>& motions) const;
  /// What a pair of the same first view allows; past kMaxPairs they are passed over.
  void Add(const std::vector<PlanarMotion>& motions);
  void Clear() { pairs_.clear(); }

  /// Earlier pairs without which nothing is told: one normal that happens to be near says little.
  static constexpr size_t kMinPairs = 2;
  static constexpr size_t kMaxPairs = 100;  ///< bounds the time

 private:
  /// The largest of the angles, radians, between a normal and what each earlier pair has next to it.
  double FarthestFrom(const Eigen::Vector3d& normal) const;

  std::vector<std::vector<PlanarMotion>> pairs_;
};

}  // namespace portolan
