#include "tracking/relocalizer.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "features/feature_matcher.h"
#include "geometry/absolute_pose.h"
#include "place_recognition/candidates.h"

namespace portolan {
namespace {

// After EPnP the keyframe's other landmarks lie within this of their projection.
constexpr double kGuidedRadiusPx = 10.0;
// Of the matches that a wrong pose finds in the windows of the fine stage (4 px) so many lie within the inliers' gate
// (2.4 px) all the same, once it is fitted to them: seen on office_walk.
constexpr double kChanceShare = 0.5;
constexpr double kSigmas = 3.0;

/// Whether more matches agree with the pose than would with a wrong one.
bool IsBeyondChance(const Frame& frame) {
  const double matches = frame.num_candidates;
  return frame.num_inliers > kChanceShare * matches + kSigmas * std::sqrt(kChanceShare * (1 - kChanceShare) * matches);
}

// Of the picture's cells in which there are features, so many at least must have an inlier. A poster or a label on a
// wall alone looks the same from two sides, and may hang elsewhere too.
constexpr double kMinSpread = 0.25;
constexpr int kCells = 8;  // each way

/// Whether the inliers vouch for more than a corner of what the frame sees.
bool IsSpread(const Frame& frame) {
  const PinholeCamera& camera = frame.data->camera;
  std::array<bool, kCells * kCells> has_feature{}, has_inlier{};
  for (size_t i = 0; i < frame.landmarks.size(); ++i) {
    const Eigen::Vector2f pixel = frame.data->features.pixels_px[i];
    const int column =
        std::clamp(static_cast<int>(pixel.x() * kCells / static_cast<float>(camera.width)), 0, kCells - 1);
    const int row = std::clamp(static_cast<int>(pixel.y() * kCells / static_cast<float>(camera.height)), 0, kCells - 1);
    const auto cell = static_cast<size_t>(row * kCells + column);
    has_feature[cell] = true;
    has_inlier[cell] = has_inlier[cell] || frame.landmarks[i].IsValid();
  }
  const auto with_inlier = std::count(has_inlier.begin(), has_inlier.end(), true);
  const auto with_feature = std::count(has_feature.begin(), has_feature.end(), true);
  return static_cast<double>(with_inlier) >= kMinSpread * static_cast<double>(with_feature);
}

/// Matches of a keyframe's landmarks with a frame's features in the same vocabulary nodes: (feature of keyframe, of
/// frame).
std::vector<FeatureMatch> MatchLandmarks(const KeyFrame& keyframe, const KeyFrameData& frame) {
  MatcherOptions matcher;
  matcher.ratio = 0.75;  // stricter than with a motion model: nothing else vouches for these matches
  const std::vector<MapPointId> landmarks = keyframe.landmarks.ByFeature();
  return MatchByNodes(
      keyframe.data->features, keyframe.data->nodes, frame.features, frame.nodes, matcher,
      [&](uint32_t i) { return landmarks[i].IsValid(); }, nullptr);
}

}  // namespace

bool Relocalizer::IsSure(const Frame& frame) {
  return IsBeyondChance(frame) && IsSpread(frame);
}

bool Relocalizer::Relocalize(const Map& map, const KeyFrameIndex& index, const std::optional<CameraReach>& reach,
                             MapTracker* tracker, Frame* frame) const {
  CandidateOptions candidate_options;
  candidate_options.most = static_cast<size_t>(options_.max_candidates);
  for (const Candidate& candidate : FindCandidates(frame->data->bow, index, map, candidate_options, nullptr)) {
    if (!TrackKeyFrame(map, candidate.keyframe, options_.min_inliers, tracker, frame) || !IsSure(*frame)) continue;
    if (!reach || reach->Contains(frame->camera_from_map)) return true;
  }
  return false;
}

bool Relocalizer::TrackKeyFrame(const Map& map, KeyFrameId id, int min_inliers, MapTracker* tracker,
                                Frame* frame) const {
  const KeyFrame* keyframe = map.FindKeyFrame(id);
  if (keyframe == nullptr) return false;
  const std::vector<FeatureMatch> matches = MatchLandmarks(*keyframe, *frame->data);
  if (static_cast<int>(matches.size()) < options_.min_matches) return false;

  std::vector<Eigen::Vector3d> landmarks_in_map;
  std::vector<Eigen::Vector2d> pixels_px;
  std::vector<double> sigmas_px;
  for (const FeatureMatch& match : matches) {
    landmarks_in_map.push_back(map.point(keyframe->landmarks[match.first]).position_in_map.cast<double>());
    pixels_px.push_back(frame->data->features.pixels_px[match.second].cast<double>());
    sigmas_px.push_back(frame->data->pyramid.Sigma(frame->data->features.octaves[match.second]));
  }
  AbsolutePoseOptions pose_options;
  pose_options.seed = seed_;
  pose_options.min_inliers = options_.min_matches * 2 / 3;
  const Result<AbsolutePose> pose =
      EstimateAbsolutePose(frame->data->camera, landmarks_in_map, pixels_px, sigmas_px, pose_options);
  if (!pose) return false;

  // "The reference frame is the previous key frame used for relocalizing" (paper Sec. 3.2).
  const auto reference = ReferenceLandmarks(map, *keyframe->data, keyframe->landmarks.ByFeature());
  tracker->TrackCoarse(map, reference, pose->camera_from_map, kGuidedRadiusPx, frame);
  return tracker->TrackFine(map, frame) >= min_inliers;
}

}  // namespace portolan
