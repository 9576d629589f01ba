#include "map_optimization/reprojection_error.h"

#include <cmath>
#include <unordered_map>
#include <vector>

#include "optimization/bundle_adjustment.h"
#include "optimization/reprojection_cost.h"

namespace portolan {
namespace {

struct View {
  Eigen::Matrix3d rotation;
  Eigen::Vector3d translation;
  const KeyFrameData* data;
  std::vector<double> sigmas;
};

/// Squared, in units of sigma^2; as BA has it for points that are not in front of the camera.
double SquaredError(const View& view, const Eigen::Vector3d& point_in_map, uint32_t feature) {
  const Eigen::Vector3d in_camera = view.rotation * point_in_map + view.translation;
  if (!(in_camera.z() > 0)) return 2 * kBehindCameraResidual * kBehindCameraResidual;
  const FeatureSet& features = view.data->features;
  const Eigen::Vector2d error_px = view.data->camera.Project(in_camera) - features.pixels_px[feature].cast<double>();
  const double sigma = view.sigmas[features.octaves[feature]];
  return error_px.squaredNorm() / (sigma * sigma);
}

}  // namespace

double MeanReprojectionLoss(const Map& map) {
  std::unordered_map<KeyFrameId, View> views;
  for (const auto& [id, keyframe] : map.keyframes()) {
    const Rigid3d& pose = keyframe.camera_from_map;
    views.emplace(id, View{pose.rotation.toRotationMatrix(), pose.translation, keyframe.data.get(),
                           keyframe.data->pyramid.Sigmas()});
  }
  constexpr double kSquaredWidth = kReprojectionLossWidth * kReprojectionLossWidth;
  double sum = 0;
  size_t count = 0;
  for (const MapPointId id : map.SortedPointIds()) {  // in order: sums of doubles depend on it
    const MapPoint& point = map.point(id);
    const Eigen::Vector3d position = point.position_in_map.cast<double>();
    for (const Observation& o : point.observations) {
      const double squared = SquaredError(views.at(o.keyframe), position, o.feature);
      sum += 0.5 * kSquaredWidth * std::log1p(squared / kSquaredWidth);
      ++count;
    }
  }
  return count > 0 ? sum / static_cast<double>(count) : 0;
}

}  // namespace portolan
