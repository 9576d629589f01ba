#include "testing/map_builder.h"

#include <utility>
#include <vector>

#include "base/check.h"
#include "base/random.h"

namespace portolan {
namespace {

Eigen::Vector3d GaussianVector(double sigma, Random* random) {
  const double x = random->Gaussian(), y = random->Gaussian(), z = random->Gaussian();
  return sigma * Eigen::Vector3d(x, y, z);
}

/// Per landmark, the (view, feature) pairs that observe it.
std::vector<std::vector<std::pair<size_t, uint32_t>>> CollectObservations(const SyntheticScene& scene, size_t num_views,
                                                                          bool keep_outliers) {
  std::vector<std::vector<std::pair<size_t, uint32_t>>> observations(scene.landmarks_in_world.size());
  for (size_t view = 0; view < num_views; ++view) {
    const SyntheticView& seen = scene.views[view];
    for (size_t feature = 0; feature < seen.landmark_of_feature.size(); ++feature) {
      const int landmark = seen.landmark_of_feature[feature];
      if (landmark == kNoLandmark || (seen.is_outlier[feature] && !keep_outliers)) continue;
      observations[static_cast<size_t>(landmark)].emplace_back(view, static_cast<uint32_t>(feature));
    }
  }
  return observations;
}

}  // namespace

MapPointId PointOfLandmark(const SyntheticScene& scene, int landmark) {
  return MapPointId(scene.options.robot, scene.options.session, static_cast<uint32_t>(landmark) + 1);
}

Map::FindData DataOf(const SyntheticScene& scene) {
  return [&scene](KeyFrameId id) -> std::shared_ptr<const KeyFrameData> {
    for (const SyntheticView& view : scene.views) {
      if (view.data->id == id) return view.data;
    }
    return nullptr;
  };
}

Map BuildMap(const SyntheticScene& scene, const MapBuilderOptions& options) {
  const size_t num_views = options.num_keyframes > 0 ? static_cast<size_t>(options.num_keyframes) : scene.views.size();
  PORTOLAN_CHECK(num_views <= scene.views.size()) << num_views << " keyframes of " << scene.views.size() << " views";
  Random random(options.seed);
  Map map(options.map, options.epoch);
  for (size_t i = 0; i < num_views; ++i) {
    Rigid3d camera_from_map = TransformPose(scene.views[i].camera_from_world, options.map_from_world);
    if (i > 0) {
      const Rigid3d noise(ExpSO3(GaussianVector(options.pose_sigma, &random)),
                          GaussianVector(options.pose_sigma, &random));
      camera_from_map = noise * camera_from_map;
    }
    map.AddKeyFrame(scene.views[i].data, camera_from_map, i > 0 ? scene.views[i - 1].data->id : KeyFrameId());
  }
  const auto observations = CollectObservations(scene, num_views, options.keep_outliers);
  for (size_t landmark = 0; landmark < observations.size(); ++landmark) {
    if (static_cast<int>(observations[landmark].size()) < options.min_observations) continue;
    const MapPointId id = PointOfLandmark(scene, static_cast<int>(landmark));
    const Eigen::Vector3d position = options.map_from_world * scene.landmarks_in_world[landmark];
    map.AddPoint(id, (position + GaussianVector(options.point_sigma, &random)).cast<float>());
    for (const auto& [view, feature] : observations[landmark])
      map.AddObservation(id, scene.views[view].data->id, feature);
  }
  map.RefreshDerived();
  return map;
}

}  // namespace portolan
