#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <optional>
#include <vector>

#include "base/result.h"
#include "geometry/camera_model.h"
#include "geometry/plane_witness.h"
#include "geometry/rigid3.h"

namespace portolan {

/// N matches between two undistorted images, in pixels, same order.
struct PixelMatches {
  std::vector<Eigen::Vector2d> first_px;
  std::vector<Eigen::Vector2d> second_px;
};

struct TwoViewOptions {
  double sigma_px = 1.0;  ///< standard deviation of a feature's location
  /// Of each model, at most: ended once a clean sample is all but certain; same samples for both.
  int ransac_iterations = 1000;
  uint64_t seed = 1;
  double min_parallax_deg = 1.0;  ///< of a triangulated point, for it to count
  int min_points = 50;            ///< triangulated points, below it the pair is refused
  double ambiguity_ratio = 0.95;  ///< the second best motion has at most this share of the best one's score
  /// Of the best motion's direction of translation, as the matches leave it: above it the pair is refused. Of 375 right
  /// pairs of all sequences 95 % have 2.2 and less, 98 % 3.1; wrong ones 2 to 20.
  double max_direction_sigma_deg = 3.5;
  /// Between the motion's rotation and the one that the images alone tell, which holds for far points: what is closer
  /// turns it by some degrees. 13 and less for 99 % of the right pairs, 20 at most; wrong ones up to 106.
  double max_rotation_difference_deg = 25;
};

/// An estimated model between two views and its support.
struct TwoViewModel {
  Eigen::Matrix3d second_from_first = Eigen::Matrix3d::Zero();  ///< F: x2^T F x1 = 0; H: x2 ~ H x1. Pixels.
  std::vector<bool> inliers;                                    ///< N
  double score = 0;  ///< sum over matches and both directions of (chi2 threshold - error) where below the threshold
};

/// Fundamental matrix by the normalised 8-point algorithm in RANSAC (paper Sec. 4.1; Hartley and Zisserman, Alg. 11.1),
/// refitted to all inliers. Fails with fewer than 8 matches. Deterministic for a seed. Scores are symmetric transfer
/// errors, truncated at chi2 3.84 (1 degree of freedom), and rewarded up to 5.99 so that F and H compare.
Result<TwoViewModel> EstimateFundamental(const PixelMatches& matches, const TwoViewOptions& options);

/// Homography by normalised DLT in RANSAC (Hartley and Zisserman, Alg. 4.1): for planar scenes, where the paper's F is
/// degenerate. Truncated at chi2 5.99 (2 degrees of freedom). Fails with fewer than 4 matches.
Result<TwoViewModel> EstimateHomography(const PixelMatches& matches, const TwoViewOptions& options);

/// The four motions of an essential matrix (paper Eq. 9), translation of length 1. In no particular order.
std::vector<Rigid3d> DecomposeEssential(const Eigen::Matrix3d& second_from_first_essential);

/// Motions of a homography between views of one calibrated camera: up to four, by OpenCV's decomposeHomographyMat
/// (Malis and Vargas 2007).
std::vector<PlanarMotion> DecomposeHomography(const Eigen::Matrix3d& second_from_first_px, const PinholeCamera& camera);

/// Structure and motion from two views.
struct TwoViewReconstruction {
  Rigid3d second_from_first;                     ///< translation of length 1
  std::vector<bool> valid;                       ///< N: the match was triangulated and passed its checks
  std::vector<Eigen::Vector3d> points_in_first;  ///< N; meaningful where valid
  double median_parallax_deg = 0;
  bool from_homography = false;  ///< the motion's start came from H
};

/// Second to fourth step of map initialisation (paper Sec. 4.1): F and H by RANSAC, the motions of both refined on all
/// matches, and of those the one that explains most matches from in front of both cameras. The score of F against that
/// of H does not choose between them: on a road ahead H wins it with a wrong motion, and on a plane refinement on E's
/// five degrees of freedom mends F. Ambiguous or poor solutions are refused with the reason rather than guessed: too
/// few points, too little parallax, a second motion nearly as good, a direction that the matches leave open.
/// @param second_from_first_by_images second from first, by the images alone (paper Eq. 3 to 6), where it is known.
/// Then motions in directions all over the sphere are refined from it too: with few matches, a narrow view or repeated
/// texture RANSAC misses the true motion or its rival. And what turns quite differently is no candidate.
/// @param witness may be null: what earlier pairs of the same first view told of a plane; this pair is added. Where all
/// that is seen is a plane, it tells the true motion from its twin, and H's motion is taken as it is: on a plane E's
/// five degrees of freedom would only spoil it.
Result<TwoViewReconstruction> ReconstructTwoViews(
    const PixelMatches& matches, const PinholeCamera& first_camera, const PinholeCamera& second_camera,
    const TwoViewOptions& options, const std::optional<Eigen::Quaterniond>& second_from_first_by_images = {},
    PlaneWitness* witness = nullptr);

/// The same by a motion that is known, up to the length of its translation: points alone. Nothing is ambiguous then,
/// and matches that don't fit are no sign of a wrong motion; only too few points with parallax are refused.
Result<TwoViewReconstruction> ReconstructByMotion(const PixelMatches& matches, const PinholeCamera& first_camera,
                                                  const PinholeCamera& second_camera, const Rigid3d& second_from_first,
                                                  const TwoViewOptions& options);

}  // namespace portolan
