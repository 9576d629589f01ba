#include "geometry/absolute_pose.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/calib3d.hpp>
#include <optional>
#include <string>

#include "base/check.h"
#include "base/random.h"

namespace portolan {
namespace {

constexpr size_t kMinMatches = 4;
constexpr size_t kSampleSize = 5;      // with four points EPnP misses a third of the poses that it finds with five
constexpr double kConfidence = 0.999;  // that one sample was free of outliers, before the iterations end early
constexpr int kMaxRefits = 5;          // to the inliers of the last fit, while their number grows
/// Smallest to middle eigenvalue of a sample's spread, below which it counts as flat: EPnP's four control points
/// degenerate on a plane (3 in 10 poses right, measured), SQPnP does not care but takes twice as long.
constexpr double kFlatness = 1e-2;

/// Matches with the pixels brought to the plane z = 1, as OpenCV takes them.
struct Matches {
  std::vector<cv::Point3d> landmarks;
  std::vector<cv::Point2d> xy;
  size_t size() const { return xy.size(); }
  void Add(const Eigen::Vector3d& landmark, const Eigen::Vector2d& normalized) {
    landmarks.emplace_back(landmark.x(), landmark.y(), landmark.z());
    xy.emplace_back(normalized.x(), normalized.y());
  }
};

bool IsFlat(const Matches& matches) {
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  Eigen::Matrix3d squares = Eigen::Matrix3d::Zero();
  for (const cv::Point3d& p : matches.landmarks)
    mean += Eigen::Vector3d(p.x, p.y, p.z) / static_cast<double>(matches.size());
  for (const cv::Point3d& p : matches.landmarks) {
    const Eigen::Vector3d d = Eigen::Vector3d(p.x, p.y, p.z) - mean;
    squares += d * d.transpose();
  }
  const Eigen::Vector3d eigenvalues =
      Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(squares, Eigen::EigenvaluesOnly).eigenvalues();
  return eigenvalues[0] < kFlatness * eigenvalues[1];
}

/// EPnP, or SQPnP (Terzakis and Lourakis, ECCV 2020) where the landmarks are flat, then Levenberg-Marquardt where
/// wanted.
std::optional<Rigid3d> SolvePnp(const Matches& matches, bool refine) {
  const int method = IsFlat(matches) ? cv::SOLVEPNP_SQPNP : cv::SOLVEPNP_EPNP;
  cv::Mat rotation, translation;
  const auto camera = cv::Matx33d::eye();
  if (!cv::solvePnP(matches.landmarks, matches.xy, camera, cv::noArray(), rotation, translation, false, method))
    return std::nullopt;
  if (refine) cv::solvePnPRefineLM(matches.landmarks, matches.xy, camera, cv::noArray(), rotation, translation);
  const Eigen::Map<const Eigen::Vector3d> r(rotation.ptr<double>()), t(translation.ptr<double>());
  if (!r.allFinite() || !t.allFinite()) return std::nullopt;
  return Rigid3d(ExpSO3(r), t);
}

/// The input and the count of inliers of a pose.
class AbsolutePoseProblem {
 public:
  AbsolutePoseProblem(const PinholeCamera& camera, const std::vector<Eigen::Vector3d>& landmarks,
                      const std::vector<Eigen::Vector2d>& pixels, const std::vector<double>& sigmas,
                      double max_error_px)
      : camera_(camera), landmarks_(landmarks), pixels_(pixels), sigmas_(sigmas), max_error_px_(max_error_px) {}

  AbsolutePose Judge(const Rigid3d& camera_from_map) const {
    AbsolutePose pose{camera_from_map, std::vector<bool>(landmarks_.size()), 0};
    const Eigen::Matrix3d rotation = camera_from_map.rotation.toRotationMatrix();
    for (size_t i = 0; i < landmarks_.size(); ++i) {
      const Eigen::Vector3d point = rotation * landmarks_[i] + camera_from_map.translation;
      const double max_error = max_error_px_ * sigmas_[i];
      pose.inliers[i] = point.z() > 0 && (camera_.Project(point) - pixels_[i]).squaredNorm() <= max_error * max_error;
      pose.num_inliers += pose.inliers[i] ? 1 : 0;
    }
    return pose;
  }

  std::optional<Rigid3d> FitSample(Random* random) const {
    std::array<size_t, kSampleSize> sample{};
    const size_t size = std::min(kSampleSize, landmarks_.size());
    Matches matches;
    for (size_t k = 0; k < size; ++k) {
      do {
        sample[k] = random->Below(landmarks_.size());
      } while (std::find(sample.begin(), sample.begin() + k, sample[k]) != sample.begin() + k);
      matches.Add(landmarks_[sample[k]], camera_.Normalize(pixels_[sample[k]]));
    }
    return SolvePnp(matches, false);
  }

  std::optional<Rigid3d> FitInliers(const AbsolutePose& pose) const {
    Matches matches;
    for (size_t i = 0; i < landmarks_.size(); ++i) {
      if (pose.inliers[i]) matches.Add(landmarks_[i], camera_.Normalize(pixels_[i]));
    }
    if (matches.size() < kMinMatches) return std::nullopt;
    return SolvePnp(matches, true);
  }

 private:
  const PinholeCamera& camera_;
  const std::vector<Eigen::Vector3d>& landmarks_;
  const std::vector<Eigen::Vector2d>& pixels_;
  const std::vector<double>& sigmas_;
  double max_error_px_;
};

/// RANSAC, ended early once a sample without outliers is all but certain.
AbsolutePose FindConsensus(const AbsolutePoseProblem& problem, size_t n, const AbsolutePoseOptions& options) {
  Random random(options.seed);
  AbsolutePose best{Rigid3d(), std::vector<bool>(n, false), 0};
  double iterations = options.ransac_iterations;
  for (int i = 0; i < iterations; ++i) {
    const std::optional<Rigid3d> candidate = problem.FitSample(&random);
    if (!candidate) continue;
    AbsolutePose pose = problem.Judge(*candidate);
    if (pose.num_inliers <= best.num_inliers) continue;
    best = std::move(pose);
    const double clean_sample = std::pow(best.num_inliers / static_cast<double>(n), static_cast<double>(kSampleSize));
    iterations =
        std::min(iterations, std::ceil(std::log(1 - kConfidence) / std::log1p(-std::min(clean_sample, kConfidence))));
  }
  return best;
}

Status CheckInput(const std::vector<Eigen::Vector3d>& landmarks, const std::vector<Eigen::Vector2d>& pixels,
                  const std::vector<double>& sigmas) {
  const size_t n = landmarks.size();
  PORTOLAN_CHECK(pixels.size() == n && sigmas.size() == n)
      << n << " landmarks, " << pixels.size() << " pixels, " << sigmas.size() << " sigmas";
  if (n < kMinMatches) return Error{"absolute pose: needs at least 4 matches, got " + std::to_string(n)};
  for (size_t i = 0; i < n; ++i) {
    if (!landmarks[i].allFinite() || !pixels[i].allFinite() || !(sigmas[i] > 0)) {
      return Error{"absolute pose: match " + std::to_string(i) + " is not finite or its sigma is not positive"};
    }
  }
  return Ok{};
}

}  // namespace

Result<AbsolutePose> EstimateAbsolutePose(const PinholeCamera& camera,
                                          const std::vector<Eigen::Vector3d>& landmarks_in_map,
                                          const std::vector<Eigen::Vector2d>& pixels_px,
                                          const std::vector<double>& sigmas_px, const AbsolutePoseOptions& options) {
  const Status usable = CheckInput(landmarks_in_map, pixels_px, sigmas_px);
  if (!usable) return usable.error();
  const AbsolutePoseProblem problem(camera, landmarks_in_map, pixels_px, sigmas_px, options.max_error_px);
  AbsolutePose best = FindConsensus(problem, landmarks_in_map.size(), options);
  for (int i = 0; i < kMaxRefits; ++i) {
    const std::optional<Rigid3d> refitted = problem.FitInliers(best);
    if (!refitted) break;
    AbsolutePose pose = problem.Judge(*refitted);
    if (pose.num_inliers < best.num_inliers) break;
    const bool settled = pose.num_inliers == best.num_inliers;
    best = std::move(pose);
    if (settled) break;
  }
  if (best.num_inliers < options.min_inliers) {
    return Error{"absolute pose: best pose has " + std::to_string(best.num_inliers) + " of " +
                 std::to_string(landmarks_in_map.size()) + " matches in agreement, need " +
                 std::to_string(options.min_inliers)};
  }
  return best;
}

}  // namespace portolan
