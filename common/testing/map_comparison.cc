#include "testing/map_comparison.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <vector>

#include "base/statistics.h"
#include "geometry/sim3_alignment.h"

namespace portolan {
namespace {

/// What is compared: the same things in the frame of the map and in the truth's, in the same order.
struct Pairs {
  std::vector<Rigid3d> camera_from_map, camera_from_truth;
  std::vector<Eigen::Vector3d> points_in_map, points_in_truth;
};

double RootMeanSquareError(const std::vector<Eigen::Vector3d>& in_map, const std::vector<Eigen::Vector3d>& in_truth) {
  const Result<Sim3d> truth_from_map = AlignPoints(in_map, in_truth);
  if (!truth_from_map.ok()) return std::numeric_limits<double>::infinity();
  double sum = 0;
  for (size_t i = 0; i < in_map.size(); ++i) sum += (*truth_from_map * in_map[i] - in_truth[i]).squaredNorm();
  return std::sqrt(sum / static_cast<double>(in_map.size()));
}

MapError Compare(const Pairs& pairs) {
  MapError error;
  error.num_keyframes = pairs.camera_from_map.size();
  error.num_points = pairs.points_in_map.size();
  std::vector<Eigen::Vector3d> in_map, in_truth;
  for (size_t i = 0; i < error.num_keyframes; ++i) {
    in_map.push_back(pairs.camera_from_map[i].TargetOriginInSource());
    in_truth.push_back(pairs.camera_from_truth[i].TargetOriginInSource());
  }
  error.camera_rmse = RootMeanSquareError(in_map, in_truth);
  in_map.insert(in_map.end(), pairs.points_in_map.begin(), pairs.points_in_map.end());
  in_truth.insert(in_truth.end(), pairs.points_in_truth.begin(), pairs.points_in_truth.end());
  const Result<Sim3d> alignment = AlignPoints(in_map, in_truth);
  if (!alignment.ok()) return error;
  error.aligned = true;
  error.truth_from_map = *alignment;
  std::vector<double> point_errors;
  for (size_t i = 0; i < error.num_keyframes; ++i) {
    const Rigid3d aligned = TransformPose(pairs.camera_from_map[i], error.truth_from_map);
    error.max_rotation_rad =
        std::max(error.max_rotation_rad, aligned.rotation.angularDistance(pairs.camera_from_truth[i].rotation));
    error.max_translation = std::max(error.max_translation, (error.truth_from_map * in_map[i] - in_truth[i]).norm());
  }
  for (size_t i = 0; i < error.num_points; ++i) {
    point_errors.push_back((error.truth_from_map * pairs.points_in_map[i] - pairs.points_in_truth[i]).norm());
    error.max_point = std::max(error.max_point, point_errors.back());
  }
  error.median_point = Quantile(point_errors, 0.5);
  return error;
}

/// The landmark that most of a point's observations show; the smaller number of equals.
int LandmarkOf(const MapPoint& point, const SyntheticScene& scene) {
  std::map<int, int> votes;
  for (const Observation& o : point.observations) {
    ++votes[scene.views[scene.ViewOf(o.keyframe)].landmark_of_feature.at(o.feature)];
  }
  votes.erase(kNoLandmark);
  int best = kNoLandmark, most = 0;
  for (const auto& [landmark, count] : votes) {
    if (count > most) {
      best = landmark;
      most = count;
    }
  }
  return best;
}

}  // namespace

MapError CompareWithScene(const Map& map, const SyntheticScene& truth) {
  Pairs pairs;
  for (const auto& [id, keyframe] : map.keyframes()) {
    pairs.camera_from_map.push_back(keyframe.camera_from_map);
    pairs.camera_from_truth.push_back(truth.views[truth.ViewOf(id)].camera_from_world);
  }
  bool stray = false;
  for (const MapPointId id : map.SortedPointIds()) {
    const MapPoint& point = map.point(id);
    const int landmark = LandmarkOf(point, truth);
    stray = stray || landmark == kNoLandmark;
    if (landmark == kNoLandmark) continue;
    pairs.points_in_map.push_back(point.position_in_map.cast<double>());
    pairs.points_in_truth.push_back(truth.landmarks_in_world[static_cast<size_t>(landmark)]);
  }
  MapError error = Compare(pairs);
  if (stray) error.max_point = std::numeric_limits<double>::infinity();
  return error;
}

MapError CompareMaps(const Map& map, const Map& truth) {
  Pairs pairs;
  for (const auto& [id, keyframe] : map.keyframes()) {
    const KeyFrame* other = truth.FindKeyFrame(id);
    if (other == nullptr) continue;
    pairs.camera_from_map.push_back(keyframe.camera_from_map);
    pairs.camera_from_truth.push_back(other->camera_from_map);
  }
  for (const MapPointId id : map.SortedPointIds()) {
    const MapPoint* other = truth.FindPoint(id);
    if (other == nullptr) continue;
    pairs.points_in_map.push_back(map.point(id).position_in_map.cast<double>());
    pairs.points_in_truth.push_back(other->position_in_map.cast<double>());
  }
  return Compare(pairs);
}

}  // namespace portolan
