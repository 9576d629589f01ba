#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "base/ids.h"
#include "base/random.h"
#include "features/feature_set.h"
#include "geometry/camera_model.h"
#include "geometry/rigid3.h"
#include "map/keyframe.h"

namespace portolan {

/// Where landmarks lie. The cameras start at the origin looking along +z; the landmarks' middle is `depth` in front.
enum class LandmarkLayout {
  kGeneral,  ///< in a box, from half to one and a half depths away
  kPlanar,   ///< on a slanted plane: a homography links all views
  kFar,      ///< a thousand depths away: no parallax
  kStreet,   ///< on both sides of a circular street of length `lap`, a fifth to three fifths of a depth from its middle
};

/// How the cameras move, evenly over the views.
enum class CameraMotion {
  kSideways,      ///< along x, looking to the landmarks' middle
  kForward,       ///< along z
  kOrbit,         ///< an arc around the landmarks' middle
  kPureRotation,  ///< turns on the spot: a degenerate motion
  kStreetLap,     ///< along the middle of the circular street, looking ahead; longer than `lap`: a revisit
};

struct SyntheticSceneOptions {
  LandmarkLayout landmarks = LandmarkLayout::kGeneral;
  CameraMotion motion = CameraMotion::kSideways;
  int num_landmarks = 500;
  int num_views = 10;
  double depth = 5.0;  ///< world units
  /// Length of the cameras' way in world units (of the arc for kOrbit); for kPureRotation its angle is travel / depth.
  double travel = 2.0;
  double lap = 40.0;            ///< length of the circular street, world units
  double sight = 0;             ///< landmarks farther than this many world units are not seen; 0: no limit
  double pixel_sigma_px = 0.0;  ///< noise of a feature at level 0; grows with its level's scale
  double outlier_ratio = 0.0;   ///< share of a view's landmark features whose location is drawn anew over the image
  /// Probability that a bit of a descriptor differs in a view (0.05: 13 bits of 256).
  double descriptor_flip_ratio = 0.0;
  int num_clutter = 0;  ///< features per view that show no landmark
  PinholeCamera camera{500, 500, 319.5, 239.5, 640, 480};
  uint64_t seed = 1;
  RobotId robot = 0;  ///< of the keyframe ids
  uint32_t session = 1;
};

constexpr int kNoLandmark = -1;

/// One camera of a scene and what it sees.
struct SyntheticView {
  Rigid3d camera_from_world;  ///< exact
  std::shared_ptr<const KeyFrameData>
      data;  ///< without bag of words; frame and id sequence are the view's number and one more
  std::vector<int> landmark_of_feature;  ///< index into the scene's landmarks, or kNoLandmark
  std::vector<bool> is_outlier;          ///< per feature: its location is wrong
};

/// Landmarks with descriptors of their own, cameras and features, with the whole truth. Features are in random order,
/// octaves fit the distances (one size of patch per landmark), a feature is left out when outside the image.
///
///   const SyntheticScene scene = MakeSyntheticScene(options);
///   scene.views[1].data->features  // what an algorithm gets
struct SyntheticScene {
  SyntheticSceneOptions options;
  std::vector<Eigen::Vector3d> landmarks_in_world;
  std::vector<Descriptor> descriptors;  ///< per landmark, without flipped bits
  std::vector<SyntheticView> views;

  /// Index of the view of a keyframe id; a check fails if there is none.
  size_t ViewOf(KeyFrameId id) const;
};
SyntheticScene MakeSyntheticScene(const SyntheticSceneOptions& options);

/// Features of two views that show the same landmark: (feature of a, feature of b), ascending in the first; outliers
/// among them.
std::vector<std::pair<uint32_t, uint32_t>> TrueMatches(const SyntheticView& a, const SyntheticView& b);

/// A descriptor drawn at random: two of them differ in 128 of 256 bits on average, in under 80 hardly ever (6 sigma).
Descriptor RandomDescriptor(Random* random);

/// camera_from_world of a camera at `eye` which looks at `target`, upright in a world with y down. They must not be one
/// above the other.
Rigid3d LookAt(const Eigen::Vector3d& eye_in_world, const Eigen::Vector3d& target_in_world);

}  // namespace portolan
