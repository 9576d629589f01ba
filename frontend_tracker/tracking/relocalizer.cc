#include "tracking/relocalizer.h"

#include "features/feature_matcher.h"
#include "geometry/absolute_pose.h"
#include "place_recognition/candidates.h"

namespace portolan {
namespace {

constexpr double kGuidedRadiusPx = 10.0;  // after EPnP the keyframe's other landmarks lie within this of their projection

/// Matches of a keyframe's landmarks with a frame's features in the same vocabulary nodes: (feature of keyframe, of frame).
std::vector<FeatureMatch> MatchLandmarks(const KeyFrame& keyframe, const KeyFrameData& frame) {
  MatcherOptions matcher;
  matcher.ratio = 0.75;  // stricter than with a motion model: nothing else vouches for these matches
  const std::vector<MapPointId> landmarks = keyframe.landmarks.ByFeature();
  return MatchByNodes(
      keyframe.data->features, keyframe.data->nodes, frame.features, frame.nodes, matcher,
      [&](uint32_t i) { return landmarks[i].IsValid(); }, nullptr);
}

}  // namespace

bool Relocalizer::Relocalize(const Map& map, const KeyFrameIndex& index, MapTracker* tracker, Frame* frame) const {
  CandidateOptions candidate_options;
  candidate_options.most = static_cast<size_t>(options_.max_candidates);
  for (const Candidate& candidate : FindCandidates(frame->data->bow, index, map, candidate_options, nullptr)) {
    if (TrackKeyFrame(map, candidate.keyframe, options_.min_inliers, tracker, frame)) return true;
  }
  return false;
}

bool Relocalizer::TrackKeyFrame(const Map& map, KeyFrameId id, int min_inliers, MapTracker* tracker, Frame* frame) const {
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
  const Result<AbsolutePose> pose = EstimateAbsolutePose(frame->data->camera, landmarks_in_map, pixels_px, sigmas_px, pose_options);
  if (!pose) return false;

  // "The reference frame is the previous key frame used for relocalizing" (paper Sec. 3.2).
  const auto reference = ReferenceLandmarks(map, *keyframe->data, keyframe->landmarks.ByFeature());
  tracker->TrackCoarse(map, reference, pose->camera_from_map, kGuidedRadiusPx, frame);
  return tracker->TrackFine(map, frame) >= min_inliers;
}

}  // namespace portolan
