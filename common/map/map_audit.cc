// Hash and audit of a map.

#include <cmath>
#include <string>
#include <vector>

#include "base/hash.h"
#include "map/map.h"

namespace portolan {

uint64_t HashMap(const Map& map) {
  Hasher hasher;
  hasher.Add(map.id().value);
  for (const CameraResidual& known : map.residuals()) {
    for (const double value :
         {known.camera.fx, known.camera.fy, known.camera.cx, known.camera.cy, known.residual.k1, known.residual.k2}) {
      hasher.AddBytes(&value, sizeof value);
    }
  }
  for (const auto& [id, keyframe] : map.keyframes()) {
    hasher.Add(id.value);
    hasher.Add(keyframe.parent.value);
    hasher.AddBytes(keyframe.camera_from_map.rotation.coeffs().data(), 4 * sizeof(double));
    hasher.AddBytes(keyframe.camera_from_map.translation.data(), 3 * sizeof(double));
  }
  for (const MapPointId id : map.SortedPointIds()) {
    const MapPoint& point = map.point(id);
    hasher.Add(id.value);
    hasher.AddBytes(point.position_in_map.data(), 3 * sizeof(float));
    for (const Observation& o : point.observations) {
      hasher.Add(o.keyframe.value);
      hasher.Add(o.feature);
    }
  }
  return hasher.Value();
}

std::vector<std::string> ValidateMap(const Map& map) {
  std::vector<std::string> violations;
  const auto violated = [&](const std::string& text) { violations.push_back(text); };
  size_t roots = 0;
  for (const auto& [id, keyframe] : map.keyframes()) {
    const std::string name = "keyframe " + ToString(id);
    if (keyframe.data == nullptr || keyframe.data->id != id) violated(name + " has no data of its own");
    if (!keyframe.camera_from_map.translation.allFinite() ||
        std::abs(keyframe.camera_from_map.rotation.norm() - 1.0) > 1e-6) {
      violated(name + " has a pose that is not a finite rigid motion");
    }
    if (!keyframe.parent.IsValid()) ++roots;
    if (keyframe.parent.IsValid() && map.FindKeyFrame(keyframe.parent) == nullptr)
      violated(name + " has an unknown parent");
    KeyFrameId ancestor = keyframe.parent;
    for (size_t steps = 0; ancestor.IsValid() && map.FindKeyFrame(ancestor) != nullptr; ++steps) {
      if (steps > map.keyframes().size()) {
        violated(name + " hangs on a circle of parents");
        break;
      }
      ancestor = map.keyframe(ancestor).parent;
    }
    const std::vector<MapPointId> landmarks = keyframe.landmarks.ByFeature();
    for (size_t feature = 0; feature < landmarks.size(); ++feature) {
      const MapPointId landmark = landmarks[feature];
      if (!landmark.IsValid()) continue;
      const MapPoint* point = map.FindPoint(landmark);
      const Observation* observation = point != nullptr ? point->FindObservation(id) : nullptr;
      if (observation == nullptr || observation->feature != feature) {
        violated(name + " feature " + std::to_string(feature) + " names a point that does not know of it");
      }
    }
  }
  if (!map.keyframes().empty() && roots != 1) violated("the spanning tree has " + std::to_string(roots) + " roots");
  for (const MapPointId id : map.SortedPointIds()) {
    const MapPoint& point = map.point(id);
    const std::string name = "point " + ToString(id);
    if (!point.position_in_map.allFinite()) violated(name + " has a position that is not finite");
    if (point.observations.size() < 2) violated(name + " is seen by fewer than two keyframes");
    for (size_t i = 0; i < point.observations.size(); ++i) {
      const Observation& o = point.observations[i];
      if (i > 0 && !(point.observations[i - 1].keyframe < o.keyframe))
        violated(name + " has observations out of order");
      const KeyFrame* keyframe = map.FindKeyFrame(o.keyframe);
      if (keyframe == nullptr || o.feature >= keyframe->landmarks.num_features() ||
          keyframe->landmarks[o.feature] != id) {
        violated(name + " is seen by " + ToString(o.keyframe) + " that does not know of it");
      }
    }
  }
  return violations;
}

}  // namespace portolan
