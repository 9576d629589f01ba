#include "geometry/two_view.h"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/calib3d.hpp>
#include <opencv2/core/eigen.hpp>
#include <sstream>

#include "base/statistics.h"
#include "geometry/epipolar_refinement.h"
#include "geometry/triangulation.h"

namespace portolan {
namespace {

constexpr double kChi2 = 3.84;  // 95 % of a chi-square with 1 degree of freedom: distance from the epipolar constraint
// A plane is all that is seen where H explains so much of what F does, and all but so few matches lie on the side of a
// normal that is seen. Chosen: the rest is for outliers.
constexpr double kPlaneShare = 0.9;
// Standard deviations of parallax from which on a match says what lies behind a camera.
constexpr double kSignificance = 3;
// Of a motion's median parallax, by which what is near turns the images otherwise than the camera: past a wall all is
// near, and it is about once the parallax (33 degrees after 1.7 m, of portolan_synth wall); the rest is for its spread.
constexpr double kTurnByParallax = 1.5;
// No farther off is what the images tell: of a wall that filled the view at first 38 degrees were the most.
constexpr double kMostTurned = 50 * M_PI / 180;
constexpr double kRefineShare = 0.5;  // motions with less of the best one's score are not worth refining
/// Of the points that agree with the motion, the share that must have parallax: a rotating camera shows a few by
/// chance, and where the few invent theirs the direction may come out reversed: 0.27 and 0.31 then on town_lap, where
/// 99 % of 375 right pairs of all sequences have 0.37 and more.
constexpr double kMinParallaxShare = 0.33;
/// Of all matches, the share that must agree with the motion: what random matches reach by chance is well below, right
/// pairs have 0.77 and more.
constexpr double kMinAgreeingShare = 0.6;
/// Two refined motions this close are one: bundle adjustment will settle the rest, where a true rival is tens of
/// degrees away.
constexpr double kSameRotation = 1 * M_PI / 180, kSameDirection = 5 * M_PI / 180;
/// Directions of translation from which the motion is refined where the rotation is known: some 40 degrees apart.
constexpr int kStarts = 24;
constexpr size_t kMaxStartMatches = 300;  // evenly drawn: enough to tell which starts lead somewhere
/// Limits of the refinement from a start, in those of the last one: the rotation is off by some degrees at first.
constexpr double kStartWidths[] = {4, 2, 1};

/// The matches with what every check of a motion needs.
struct CalibratedMatches {
  CalibratedMatches(const PixelMatches& matches, const PinholeCamera& first, const PinholeCamera& second,
                    const TwoViewOptions& o)
      : pixels(matches), first_camera(first), second_camera(second), options(o) {
    for (const Eigen::Vector2d& p : matches.first_px) first_xy.push_back(first.Normalize(p));
    for (const Eigen::Vector2d& p : matches.second_px) second_xy.push_back(second.Normalize(p));
    const double mean_focal_length = 0.25 * (first.fx + first.fy + second.fx + second.fy);
    sigma_xy = options.sigma_px / mean_focal_length;
    max_parallax_cosine = std::cos(options.min_parallax_deg * M_PI / 180);
    max_sign_cosine = std::cos(kSignificance * M_SQRT2 * sigma_xy);
  }
  size_t size() const { return first_xy.size(); }

  const PixelMatches& pixels;
  const PinholeCamera &first_camera, &second_camera;
  const TwoViewOptions& options;
  std::vector<Eigen::Vector2d> first_xy, second_xy;
  double sigma_xy;             // of a feature, on the plane z = 1
  double max_parallax_cosine;  // of a point of the map
  double max_sign_cosine;      // of a match whose depths have a sign
};

/// Whether the rays of a match meet in front of both cameras, or have too little parallax to tell.
bool MayBeInFront(const Eigen::Vector3d& first_ray, const Eigen::Vector3d& second_ray,
                  const Eigen::Vector3d& translation, double max_sign_cosine) {
  const double ff = first_ray.squaredNorm(), ss = second_ray.squaredNorm(), fs = first_ray.dot(second_ray);
  if (fs > 0 && fs * fs > max_sign_cosine * max_sign_cosine * ff * ss) return true;
  // Least squares of first_depth * first_ray + translation = second_depth * second_ray; only the signs matter.
  const double ft = first_ray.dot(translation), st = second_ray.dot(translation);
  return fs * st - ss * ft > 0 && ff * st - fs * ft > 0;
}

/// How well a motion explains the matches: sum of chi2 threshold minus squared Sampson distance in sigma^2, where
/// positive and not behind a camera. Matches of little parallax count like all others: a wrong motion often invents
/// parallax.
double ScoreMotion(const CalibratedMatches& m, const Rigid3d& motion) {
  const Eigen::Matrix3d rotation = motion.rotation.toRotationMatrix();
  const Eigen::Matrix3d essential = Skew(motion.translation) * rotation;
  const double inverse_variance = 1 / (m.sigma_xy * m.sigma_xy);
  double score = 0;
  for (size_t i = 0; i < m.size(); ++i) {
    const Eigen::Vector3d x1 = m.first_xy[i].homogeneous(), x2 = m.second_xy[i].homogeneous();
    const Eigen::Vector3d line2 = essential * x1;
    const Eigen::Vector2d line1 = essential.leftCols<2>().transpose() * x2;
    const double product = x2.dot(line2);
    const double error2 = product * product / (line1.squaredNorm() + line2.head<2>().squaredNorm()) * inverse_variance;
    if (error2 < kChi2 && MayBeInFront(rotation * x1, x2, motion.translation, m.max_sign_cosine))
      score += kChi2 - error2;
  }
  return score;
}

struct Candidate {
  Rigid3d motion;
  bool from_homography = false;
  double score = 0;
};

bool IsSameMotion(const Rigid3d& a, const Rigid3d& b) {
  return a.rotation.angularDistance(b.rotation) < kSameRotation &&
         a.translation.dot(b.translation) > std::cos(kSameDirection);
}

/// Unit vectors spread evenly over the sphere (Fibonacci's lattice).
std::vector<Eigen::Vector3d> SpreadDirections(int n) {
  const double golden_angle = M_PI * (3 - std::sqrt(5.0));
  std::vector<Eigen::Vector3d> directions;
  for (int i = 0; i < n; ++i) {
    const double z = 1 - (2 * i + 1.0) / n, radius = std::sqrt(1 - z * z);
    directions.emplace_back(radius * std::cos(golden_angle * i), radius * std::sin(golden_angle * i), z);
  }
  return directions;
}

/// Where refinement ends that starts from a rotation and from directions all over the sphere; each motion once.
std::vector<Candidate> MotionsByRotation(const CalibratedMatches& m, const Eigen::Quaterniond& rotation) {
  const size_t stride = (m.size() + kMaxStartMatches - 1) / kMaxStartMatches;
  std::vector<Eigen::Vector2d> first_xy, second_xy;
  for (size_t i = 0; i < m.size(); i += stride) {
    first_xy.push_back(m.first_xy[i]);
    second_xy.push_back(m.second_xy[i]);
  }
  std::vector<Candidate> candidates;
  for (const Eigen::Vector3d& direction : SpreadDirections(kStarts)) {
    Rigid3d motion(rotation, direction);
    for (const double width : kStartWidths)
      motion = RefineMotion(motion, first_xy, second_xy, width * std::sqrt(kChi2) * m.sigma_xy);
    const bool is_new = std::none_of(candidates.begin(), candidates.end(),
                                     [&](const Candidate& other) { return IsSameMotion(motion, other.motion); });
    if (is_new) candidates.push_back({motion, false});
  }
  return candidates;
}

/// Standard deviation of a motion's direction of translation, radians, by the matches that agree with it; infinite
/// where they leave it open.
double DirectionSigma(const CalibratedMatches& m, const Rigid3d& motion) {
  const double max_distance = std::sqrt(kChi2) * m.sigma_xy;
  Eigen::Matrix<double, 5, 5> information = Eigen::Matrix<double, 5, 5>::Zero();
  for (size_t i = 0; i < m.size(); ++i) {
    Eigen::Matrix<double, 5, 1> gradient;
    if (std::abs(SampsonDistance(motion, m.first_xy[i], m.second_xy[i], &gradient)) < max_distance)
      information.noalias() += gradient * gradient.transpose() / (m.sigma_xy * m.sigma_xy);
  }
  const Eigen::FullPivLU<Eigen::Matrix<double, 5, 5>> lu(information);
  if (!lu.isInvertible()) return std::numeric_limits<double>::infinity();
  const Eigen::Matrix2d covariance = lu.inverse().topLeftCorner<2, 2>();
  return std::sqrt(Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d>(covariance).eigenvalues().maxCoeff());
}

/// By how much a motion may turn otherwise than the images do, radians.
double MostTurned(const CalibratedMatches& m, const Rigid3d& motion) {
  std::vector<double> parallaxes;
  for (size_t i = 0; i < m.size(); ++i) {
    const Eigen::Vector3d first_ray = motion.rotation * m.first_xy[i].homogeneous();
    const Eigen::Vector3d second_ray = m.second_xy[i].homogeneous();
    parallaxes.push_back(std::atan2(first_ray.cross(second_ray).norm(), first_ray.dot(second_ray)));
  }
  const double at_least = m.options.max_rotation_difference_deg * M_PI / 180;
  return std::clamp(kTurnByParallax * Quantile(std::move(parallaxes), 0.5), at_least, std::max(at_least, kMostTurned));
}

/// Refines the motions worth it, and returns those best first that turn about as the images do, where that is known.
std::vector<Candidate> RankMotions(const CalibratedMatches& m, std::vector<Candidate> candidates,
                                   const std::optional<Eigen::Quaterniond>& second_from_first_by_images) {
  double most = 0;
  for (Candidate& candidate : candidates) {
    candidate.score = ScoreMotion(m, candidate.motion);
    most = std::max(most, candidate.score);
  }
  std::vector<Candidate> ranked;
  for (Candidate& candidate : candidates) {
    if (candidate.score == 0 || candidate.score < kRefineShare * most) continue;
    candidate.motion = RefineMotion(candidate.motion, m.first_xy, m.second_xy, std::sqrt(kChi2) * m.sigma_xy);
    if (second_from_first_by_images &&
        candidate.motion.rotation.angularDistance(*second_from_first_by_images) > MostTurned(m, candidate.motion))
      continue;
    candidate.score = ScoreMotion(m, candidate.motion);
    ranked.push_back(candidate);
  }
  std::stable_sort(ranked.begin(), ranked.end(),
                   [](const Candidate& a, const Candidate& b) { return a.score > b.score; });
  return ranked;
}

/// The best motion that differs from the first and explains the matches nearly as well, or null.
const Candidate* FindRival(const std::vector<Candidate>& ranked, double ambiguity_ratio) {
  const auto is_rival = [&](const Candidate& other) {
    return other.score > ambiguity_ratio * ranked[0].score && !IsSameMotion(other.motion, ranked[0].motion);
  };
  const auto rival = std::find_if(ranked.begin() + 1, ranked.end(), is_rival);
  return rival == ranked.end() ? nullptr : &*rival;
}

/// Triangulates all matches by the chosen motion: optimal correction (paper Eq. 10), DLT (paper Eq. 11), checks.
/// @return how many points agree with the motion, with or without enough parallax.
int Triangulate(const CalibratedMatches& m, TwoViewReconstruction* result) {
  const Rigid3d& motion = result->second_from_first;
  const Eigen::Matrix3d fundamental = FundamentalFromMotion(motion, m.first_camera, m.second_camera);
  const Eigen::Vector3d second_centre = motion.TargetOriginInSource();
  result->valid.assign(m.size(), false);
  result->points_in_first.assign(m.size(), Eigen::Vector3d::Zero());
  std::vector<double> parallaxes_deg;
  for (size_t i = 0; i < m.size(); ++i) {
    const auto [first_px, second_px] = CorrectMatch(fundamental, m.pixels.first_px[i], m.pixels.second_px[i]);
    if ((first_px - m.pixels.first_px[i]).squaredNorm() + (second_px - m.pixels.second_px[i]).squaredNorm() >
        kChi2 * m.options.sigma_px * m.options.sigma_px) {
      continue;
    }
    const auto point =
        TriangulateDlt(Rigid3d(), motion, m.first_camera.Normalize(first_px), m.second_camera.Normalize(second_px));
    if (!point) continue;
    const double parallax_cosine = ParallaxCosine(Eigen::Vector3d::Zero(), second_centre, *point);
    const bool has_parallax = parallax_cosine < m.max_parallax_cosine;
    const bool in_front = point->z() > 0 && (motion * *point).z() > 0;
    if (has_parallax && !in_front) continue;
    parallaxes_deg.push_back(std::acos(std::clamp(parallax_cosine, -1.0, 1.0)) * 180 / M_PI);
    result->points_in_first[i] = *point;
    result->valid[i] = has_parallax;
  }
  result->median_parallax_deg = Quantile(parallaxes_deg, 0.5);
  return static_cast<int>(parallaxes_deg.size());
}

/// The motions of a plane that is all there is to be seen; none if there is more. More than one: it is open which.
std::vector<PlanarMotion> MotionsOfPlane(const CalibratedMatches& m, const TwoViewModel& fundamental,
                                         const TwoViewModel& homography, const std::vector<PlanarMotion>& motions) {
  const auto count = [](const std::vector<bool>& flags) { return std::count(flags.begin(), flags.end(), true); };
  const auto on_plane = static_cast<double>(count(homography.inliers));
  if (on_plane < kPlaneShare * static_cast<double>(count(fundamental.inliers))) return {};
  std::vector<PlanarMotion> visible;
  for (const PlanarMotion& motion : motions) {
    int seen = 0;
    for (size_t i = 0; i < m.size(); ++i)
      seen += homography.inliers[i] && motion.normal_in_first.dot(m.first_xy[i].homogeneous()) > 0 ? 1 : 0;
    if (seen >= kPlaneShare * on_plane) visible.push_back(motion);
  }
  return visible;
}

/// The motions of the homography and of the fundamental matrix (paper Eq. 9), and those that the images' rotation leads
/// to.
std::vector<Candidate> CandidateMotions(const CalibratedMatches& m, const TwoViewModel& fundamental,
                                        const std::vector<PlanarMotion>& of_homography,
                                        const std::optional<Eigen::Quaterniond>& second_from_first_by_images) {
  const Eigen::Matrix3d K1 = m.first_camera.K(), K2 = m.second_camera.K();
  std::vector<Candidate> candidates;
  for (const PlanarMotion& motion : of_homography) candidates.push_back({motion.second_from_first, true});
  for (const Rigid3d& motion : DecomposeEssential(K2.transpose() * fundamental.second_from_first * K1)) {
    candidates.push_back({motion, false});
  }
  if (second_from_first_by_images) {
    for (const Candidate& candidate : MotionsByRotation(m, *second_from_first_by_images))
      candidates.push_back(candidate);
  }
  return candidates;
}

template <class... Parts>
Error Refused(const Parts&... parts) {
  std::ostringstream text;
  text << "two views: ";
  (text << ... << parts);
  return Error{text.str()};
}

}  // namespace

std::vector<Rigid3d> DecomposeEssential(const Eigen::Matrix3d& second_from_first_essential) {
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(second_from_first_essential, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Matrix3d U = svd.matrixU(), V = svd.matrixV();
  if (U.determinant() < 0) U = -U;
  if (V.determinant() < 0) V = -V;
  Eigen::Matrix3d W;  // Hartley and Zisserman, Result 9.19
  W << 0, -1, 0, 1, 0, 0, 0, 0, 1;
  const Eigen::Quaterniond rotations[] = {Eigen::Quaterniond(Eigen::Matrix3d(U * W * V.transpose())),
                                          Eigen::Quaterniond(Eigen::Matrix3d(U * W.transpose() * V.transpose()))};
  std::vector<Rigid3d> motions;
  for (const Eigen::Quaterniond& rotation : rotations) {
    motions.emplace_back(rotation.normalized(), U.col(2));
    motions.emplace_back(rotation.normalized(), -U.col(2));
  }
  return motions;
}

std::vector<PlanarMotion> DecomposeHomography(const Eigen::Matrix3d& second_from_first_px,
                                              const PinholeCamera& camera) {
  // A plane in front of both cameras is seen from the same side by both: the true scale of H has a positive
  // determinant.
  const double sign = second_from_first_px.determinant() < 0 ? -1 : 1;
  cv::Mat H, K;
  cv::eigen2cv(Eigen::Matrix3d(sign * second_from_first_px), H);
  cv::eigen2cv(camera.K(), K);
  std::vector<cv::Mat> rotations, translations, normals;
  cv::decomposeHomographyMat(H, K, rotations, translations, normals);
  std::vector<PlanarMotion> motions;
  for (size_t i = 0; i < rotations.size(); ++i) {
    Eigen::Matrix3d rotation;
    Eigen::Vector3d translation, normal;
    cv::cv2eigen(rotations[i], rotation);
    cv::cv2eigen(translations[i], translation);
    cv::cv2eigen(normals[i], normal);
    if (!rotation.allFinite() || !(translation.norm() > 0))
      continue;  // a pure rotation has no direction of translation
    motions.push_back({Rigid3d(Eigen::Quaterniond(rotation).normalized(), translation.normalized()), normal});
  }
  return motions;
}

Result<TwoViewReconstruction> ReconstructTwoViews(const PixelMatches& matches, const PinholeCamera& first_camera,
                                                  const PinholeCamera& second_camera, const TwoViewOptions& options,
                                                  const std::optional<Eigen::Quaterniond>& second_from_first_by_images,
                                                  PlaneWitness* witness) {
  const Result<TwoViewModel> fundamental = EstimateFundamental(matches, options);
  if (!fundamental) return fundamental.error();
  const CalibratedMatches calibrated(matches, first_camera, second_camera, options);
  const Result<TwoViewModel> homography = EstimateHomography(matches, options);
  std::vector<PlanarMotion> of_homography;
  std::optional<PlanarMotion> of_plane;
  if (homography) {
    const Eigen::Matrix3d in_first_pixels =
        first_camera.K() * second_camera.K().inverse() * homography->second_from_first;
    of_homography = DecomposeHomography(in_first_pixels, first_camera);
  }
  if (homography && witness != nullptr) {
    const std::vector<PlanarMotion> motions = MotionsOfPlane(calibrated, *fundamental, *homography, of_homography);
    if (const auto judged = witness->Judge(motions)) of_plane = motions[*judged];
    witness->Add(motions);
  }

  std::vector<Candidate> ranked;
  if (of_plane) {
    ranked.push_back({of_plane->second_from_first, true});
  } else {
    ranked =
        RankMotions(calibrated, CandidateMotions(calibrated, *fundamental, of_homography, second_from_first_by_images),
                    second_from_first_by_images);
  }
  if (ranked.empty()) return Refused("no motion explains the matches");

  TwoViewReconstruction result;
  result.second_from_first = ranked[0].motion;
  result.from_homography = ranked[0].from_homography;
  const int agreeing = Triangulate(calibrated, &result);
  const int valid = static_cast<int>(std::count(result.valid.begin(), result.valid.end(), true));
  if (agreeing < options.min_points || agreeing < kMinAgreeingShare * static_cast<double>(matches.first_px.size())) {
    return Refused("only ", agreeing, " of ", matches.first_px.size(), " matches agree with a motion, need ",
                   options.min_points);
  }
  if (valid < options.min_points || valid < kMinParallaxShare * agreeing) {
    return Refused("too little parallax, ", valid, " of ", agreeing, " points have ", options.min_parallax_deg,
                   " deg, median is ", result.median_parallax_deg, " deg");
  }
  if (of_plane) return result;
  if (const Candidate* rival = FindRival(ranked, options.ambiguity_ratio)) {
    return Refused("ambiguous, two motions explain the matches with scores ", ranked[0].score, " and ", rival->score);
  }
  const double sigma_deg = DirectionSigma(calibrated, ranked[0].motion) * 180 / M_PI;
  if (!(sigma_deg <= options.max_direction_sigma_deg))
    return Refused("the direction of translation is known to ", sigma_deg, " deg only");
  return result;
}

Result<TwoViewReconstruction> ReconstructByMotion(const PixelMatches& matches, const PinholeCamera& first_camera,
                                                  const PinholeCamera& second_camera, const Rigid3d& second_from_first,
                                                  const TwoViewOptions& options) {
  const double length = second_from_first.translation.norm();
  if (!(length > 0)) return Refused("a known motion without translation");
  TwoViewReconstruction result;
  result.second_from_first = Rigid3d(second_from_first.rotation, second_from_first.translation / length);
  const int agreeing = Triangulate(CalibratedMatches(matches, first_camera, second_camera, options), &result);
  const int valid = static_cast<int>(std::count(result.valid.begin(), result.valid.end(), true));
  if (valid >= options.min_points) return result;
  return Refused("too little parallax in a known motion, ", valid, " of ", agreeing, " points have ",
                 options.min_parallax_deg, " deg, need ", options.min_points);
}

}  // namespace portolan
