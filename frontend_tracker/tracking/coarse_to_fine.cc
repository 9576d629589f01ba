#include "tracking/coarse_to_fine.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <unordered_set>

#include "optimization/pose_optimization.h"

namespace portolan {
namespace {

// Of motion-only BA in the coarse stage: its loss narrows from the wide windows' radius in five, and one more settles
// the inliers.
constexpr int kCoarseRounds = 6;
// Of the reference's landmarks. With a prediction that is farther off than the windows reach up to a tenth are found
// all the same, where they are not (seen on office_walk, 24 of 470 at its worst jerk); with a good one half and more.
constexpr double kFoundByChance = 0.25;

/// Best and second best feature for a descriptor among candidates.
struct BestMatch {
  int index = -1;
  int distance = 257, second_distance = 257;
  int octave = -1, second_octave = -1;
};

BestMatch FindBest(const Descriptor& descriptor, const FeatureSet& features, const std::vector<uint32_t>& candidates,
                   const std::vector<MapPointId>& taken) {
  BestMatch best;
  for (const uint32_t i : candidates) {
    if (taken[i].IsValid()) continue;
    const int distance = HammingDistance(descriptor, features.descriptors[i]);
    if (distance < best.distance) {
      best.second_distance = best.distance;
      best.second_octave = best.octave;
      best.distance = distance;
      best.octave = features.octaves[i];
      best.index = static_cast<int>(i);
    } else if (distance < best.second_distance) {
      best.second_distance = distance;
      best.second_octave = features.octaves[i];
    }
  }
  return best;
}

/// Takes back landmarks whose feature turned otherwise than most did since the reference (30 bins, the three fullest
/// stay).
void DropInconsistentOrientation(const std::vector<std::pair<uint32_t, float>>& turns, Frame* frame) {
  constexpr int kBins = 30;
  std::array<int, kBins> counts{};
  const auto bin_of = [](float turn) {
    const double wrapped = turn - 2 * M_PI * std::floor(turn / (2 * M_PI));
    return std::min(kBins - 1, static_cast<int>(wrapped * kBins / (2 * M_PI)));
  };
  for (const auto& [feature, turn] : turns) ++counts[static_cast<size_t>(bin_of(turn))];
  std::array<int, kBins> sorted = counts;
  std::sort(sorted.begin(), sorted.end(), std::greater<>());
  const int least = std::max({sorted[2], sorted[0] / 10, 1});
  for (const auto& [feature, turn] : turns) {
    if (counts[static_cast<size_t>(bin_of(turn))] < least) frame->landmarks[feature] = MapPointId();
  }
}

/// Level at which a landmark at this distance is expected: detected at max_distance it would be at level 0.
int PredictOctave(double distance, double max_distance, const ScalePyramid& pyramid) {
  const double octave = std::ceil(std::log(max_distance / distance) / std::log(pyramid.factor));
  return std::clamp(static_cast<int>(octave), 0, pyramid.levels - 1);
}

}  // namespace

std::vector<ReferenceLandmark> ReferenceLandmarks(const Map& map, const KeyFrameData& data,
                                                  const std::vector<MapPointId>& landmarks) {
  std::vector<ReferenceLandmark> reference;
  for (size_t i = 0; i < landmarks.size(); ++i) {
    const MapPoint* point = landmarks[i].IsValid() ? map.FindPoint(landmarks[i]) : nullptr;
    if (point == nullptr) continue;
    reference.push_back({landmarks[i], point->position_in_map.cast<double>(), data.features.descriptors[i],
                         data.features.octaves[i], data.features.angles_rad[i]});
  }
  return reference;
}

int OptimizeFramePose(const Map& map, Frame* frame, const PoseOptimizationOptions& options) {
  const FeatureSet& features = frame->data->features;
  PoseMatches matches;
  std::vector<size_t> feature_of_match;
  const std::vector<double> sigmas = frame->data->pyramid.Sigmas();
  for (size_t i = 0; i < frame->landmarks.size(); ++i) {
    if (!frame->landmarks[i].IsValid()) continue;
    const MapPoint* point = map.FindPoint(frame->landmarks[i]);
    if (point == nullptr) {
      frame->landmarks[i] = MapPointId();
      continue;
    }
    matches.landmarks_in_map.push_back(point->position_in_map.cast<double>());
    matches.pixels_px.push_back(features.pixels_px[i].cast<double>());
    matches.sigmas_px.push_back(sigmas[features.octaves[i]]);
    feature_of_match.push_back(i);
  }
  const PoseOptimizationResult result = OptimizePose(frame->data->camera, matches, frame->camera_from_map, options);
  frame->camera_from_map = result.camera_from_map;
  frame->num_candidates = static_cast<int>(feature_of_match.size());  // m
  frame->num_inliers = result.num_inliers;                            // n
  for (size_t k = 0; k < feature_of_match.size(); ++k) {
    if (!result.inliers[k]) frame->landmarks[feature_of_match[k]] = MapPointId();
  }
  return frame->num_inliers;
}

bool IsFound(const Frame& frame, const TrackerOptions& options) {
  return frame.num_inliers >= options.min_tracked_points &&
         (frame.num_inliers >= options.keyframe.sure_points || frame.Quality() > options.min_tracked_quality);
}

int MapTracker::TrackCoarse(const Map& map, const std::vector<ReferenceLandmark>& reference,
                            const Rigid3d& predicted_camera_from_map, double radius_px, Frame* frame) const {
  const KeyFrameData& data = *frame->data;
  const std::vector<double> scales = data.pyramid.Scales();
  frame->camera_from_map = predicted_camera_from_map;
  frame->landmarks.assign(data.features.size(), MapPointId());
  std::vector<std::pair<uint32_t, float>> turns;
  std::vector<uint32_t> near;
  for (const ReferenceLandmark& landmark : reference) {
    const Eigen::Vector3d in_camera = predicted_camera_from_map * landmark.position_in_map;
    if (in_camera.z() <= 0) continue;
    const Eigen::Vector2d pixel = data.camera.Project(in_camera);
    if (!data.camera.Contains(pixel)) continue;
    near.clear();
    data.grid.Find(data.features, pixel, radius_px * scales[landmark.octave], landmark.octave - 1, landmark.octave + 1,
                   &near);
    const BestMatch best = FindBest(landmark.descriptor, data.features, near, frame->landmarks);
    if (best.distance > options_.max_distance) continue;
    const auto feature = static_cast<uint32_t>(best.index);
    frame->landmarks[feature] = landmark.id;
    turns.emplace_back(feature, data.features.angles_rad[feature] - landmark.angle_rad);
  }
  DropInconsistentOrientation(turns, frame);
  PoseOptimizationOptions from_prediction;
  from_prediction.first_loss_width = radius_px;  // the standard deviation of a location at level 0 is a pixel
  from_prediction.rounds = kCoarseRounds;
  return OptimizeFramePose(map, frame, from_prediction);
}

int MapTracker::TrackCoarse(const Map& map, const std::vector<ReferenceLandmark>& reference,
                            const std::vector<Rigid3d>& predictions, Frame* frame) const {
  const auto in_all = static_cast<double>(reference.size());
  const double enough = options_.min_coarse_share * in_all;
  const double not_by_chance = std::max<double>(kFoundByChance * in_all, options_.min_coarse_inliers);
  Frame best;  // pose, landmarks and counts alone
  for (const double radius_px : {options_.coarse_radius_px, options_.wide_radius_px}) {
    if (!best.landmarks.empty() && best.num_inliers >= not_by_chance) break;
    for (const Rigid3d& predicted : predictions) {
      const int inliers = TrackCoarse(map, reference, predicted, radius_px, frame);
      if (inliers >= enough) return inliers;
      if (!best.landmarks.empty() && inliers <= best.num_inliers) continue;
      best.camera_from_map = frame->camera_from_map;
      best.landmarks = frame->landmarks;
      best.num_inliers = frame->num_inliers;
      best.num_candidates = frame->num_candidates;
    }
  }
  frame->camera_from_map = best.camera_from_map;
  frame->landmarks = std::move(best.landmarks);
  frame->num_inliers = best.num_inliers;
  frame->num_candidates = best.num_candidates;
  return frame->num_inliers;
}

int MapTracker::TrackFine(const Map& map, Frame* frame) {
  local_map_.Update(map, frame->landmarks, options_.max_local_keyframes);
  const bool enough = frame->num_inliers >= options_.min_coarse_inliers;
  AddLocalLandmarks(enough ? options_.fine_radius_px : options_.fine_wide_radius_px, frame);
  frame->reference = local_map_.reference();
  return OptimizeFramePose(map, frame);
}

void MapTracker::AddLocalLandmarks(double radius_px, Frame* frame) const {
  const KeyFrameData& data = *frame->data;
  const std::vector<double> scales = data.pyramid.Scales();
  const Eigen::Vector3d centre = frame->camera_from_map.TargetOriginInSource();
  const Eigen::Matrix3d rotation = frame->camera_from_map.rotation.toRotationMatrix();
  std::unordered_set<MapPointId> matched;
  for (const MapPointId id : frame->landmarks) {
    if (id.IsValid()) matched.insert(id);
  }
  std::vector<uint32_t> near;
  for (const LocalMap::Landmark& landmark : local_map_.landmarks()) {
    const Eigen::Vector3d ray = landmark.position_in_map - centre;
    const Eigen::Vector3d in_camera = rotation * ray;
    if (in_camera.z() <= 0) continue;
    const Eigen::Vector2d pixel = data.camera.Project(in_camera);
    if (!data.camera.Contains(pixel)) continue;
    const double distance = ray.norm();
    // A fifth beyond the range in which its features were seen, for the pyramid's own steps.
    if (distance < 0.8 * landmark.min_distance || distance > 1.2 * landmark.max_distance) continue;
    const double view_cosine = ray.dot(landmark.mean_viewing_direction.cast<double>()) / distance;
    if (view_cosine < options_.min_view_cosine || matched.count(landmark.id) == 1) continue;
    const int octave = PredictOctave(distance, landmark.max_distance, data.pyramid);
    near.clear();
    data.grid.Find(data.features, pixel, radius_px * scales[static_cast<size_t>(octave)], octave - 1, octave + 1,
                   &near);
    const BestMatch best = FindBest(landmark.descriptor, data.features, near, frame->landmarks);
    if (best.distance > options_.max_distance) continue;
    if (best.octave == best.second_octave && best.distance > options_.ratio * best.second_distance) continue;
    frame->landmarks[static_cast<size_t>(best.index)] = landmark.id;
  }
}

}  // namespace portolan
