#include "testing/drifted_map.h"

#include <map>

#include "base/check.h"
#include "base/random.h"

namespace portolan {
namespace {

struct Sighting {
  size_t view;
  uint32_t feature;
};

Eigen::Vector3d GaussianVector(double sigma, Random* random) {
  const double x = random->Gaussian(), y = random->Gaussian(), z = random->Gaussian();
  return sigma * Eigen::Vector3d(x, y, z);
}

/// Sightings of each landmark in order, split into visits.
std::vector<std::vector<std::vector<Sighting>>> CollectVisits(const SyntheticScene& scene, int revisit_gap) {
  std::vector<std::vector<std::vector<Sighting>>> visits(scene.landmarks_in_world.size());
  for (size_t view = 0; view < scene.views.size(); ++view) {
    const SyntheticView& seen = scene.views[view];
    for (size_t feature = 0; feature < seen.landmark_of_feature.size(); ++feature) {
      if (seen.landmark_of_feature[feature] == kNoLandmark || seen.is_outlier[feature]) continue;
      auto& of_landmark = visits[static_cast<size_t>(seen.landmark_of_feature[feature])];
      const bool is_new =
          of_landmark.empty() || view - of_landmark.back().back().view > static_cast<size_t>(revisit_gap);
      if (is_new) of_landmark.emplace_back();
      of_landmark.back().push_back({view, static_cast<uint32_t>(feature)});
    }
  }
  return visits;
}

void AddKeyFrames(const SyntheticScene& scene, const DriftOptions& options, Random* random, DriftedMap* drifted) {
  Rigid3d camera_from_map;
  double scale = 1;
  for (size_t view = 0; view < scene.views.size(); ++view) {
    if (view == 0) {
      camera_from_map = scene.views[0].camera_from_world;
    } else {
      scale *= options.scale_step;
      const Rigid3d step = scene.views[view].camera_from_world * scene.views[view - 1].camera_from_world.Inverse();
      camera_from_map = Rigid3d(ExpSO3(options.turn_step) * step.rotation, scale * step.translation) * camera_from_map;
    }
    drifted->scales.push_back(scale);
    const Rigid3d noise(ExpSO3(GaussianVector(options.pose_sigma, random)), GaussianVector(options.pose_sigma, random));
    drifted->map.AddKeyFrame(scene.views[view].data, view > 0 ? noise * camera_from_map : camera_from_map,
                             view > 0 ? scene.views[view - 1].data->id : KeyFrameId());
  }
}

}  // namespace

Sim3d DriftedMap::TrueSimilarity(const SyntheticScene& scene, size_t view_a, size_t view_b) const {
  const Rigid3d a_from_b = scene.views[view_a].camera_from_world * scene.views[view_b].camera_from_world.Inverse();
  return Sim3d(scales[view_a] / scales[view_b], a_from_b.rotation, scales[view_a] * a_from_b.translation);
}

std::vector<std::pair<uint32_t, MapPointId>> DriftedMap::TrueSightings(const SyntheticScene& scene, size_t view_a,
                                                                       size_t view_b) const {
  std::vector<std::pair<uint32_t, MapPointId>> sightings;
  const KeyFrame& b = map.keyframe(scene.views[view_b].data->id);
  for (const auto& [in_a, in_b] : TrueMatches(scene.views[view_a], scene.views[view_b])) {
    if (b.landmarks[in_b].IsValid()) sightings.emplace_back(in_a, b.landmarks[in_b]);
  }
  return sightings;
}

DriftedMap BuildDriftedMap(const SyntheticScene& scene, const DriftOptions& options) {
  PORTOLAN_CHECK(options.scale_step > 0);
  Random random(options.seed);
  DriftedMap drifted{Map(MapBuilderOptions().map, MapBuilderOptions().epoch), {}};
  AddKeyFrames(scene, options, &random, &drifted);
  const auto visits = CollectVisits(scene, options.revisit_gap);
  uint32_t next = 1;
  for (size_t landmark = 0; landmark < visits.size(); ++landmark) {
    for (const std::vector<Sighting>& visit : visits[landmark]) {
      if (visit.size() < 2) continue;
      const size_t view = visit[visit.size() / 2].view;
      const Eigen::Vector3d in_camera = scene.views[view].camera_from_world * scene.landmarks_in_world[landmark];
      const Rigid3d& camera_from_map = drifted.map.keyframe(scene.views[view].data->id).camera_from_map;
      const MapPointId id(scene.options.robot, scene.options.session, next++);
      const Eigen::Vector3d position = camera_from_map.Inverse() * (drifted.scales[view] * in_camera);
      drifted.map.AddPoint(id, (position + GaussianVector(options.point_sigma, &random)).cast<float>());
      for (const Sighting& s : visit) drifted.map.AddObservation(id, scene.views[s.view].data->id, s.feature);
    }
  }
  drifted.map.RefreshDerived();
  return drifted;
}

}  // namespace portolan
