#pragma once

#include "testing/map_builder.h"
#include "testing/synthetic_scene.h"
#include "tracking/frame.h"

namespace portolan {

/// A scene's view as the tracker gets it: nothing known but its features. For tests.
inline Frame FrameOfView(const SyntheticScene& scene, size_t view) {
  Frame frame;
  frame.data = scene.views.at(view).data;
  frame.number = frame.data->frame;
  frame.stamp = frame.data->stamp;
  frame.landmarks.resize(frame.data->features.size());
  return frame;
}

/// The landmarks that a view's features really show, as points of BuildMap's map; none for outliers and what is not in
/// the map.
inline std::vector<MapPointId> TrueLandmarks(const SyntheticScene& scene, size_t view, const Map& map) {
  const SyntheticView& seen = scene.views.at(view);
  std::vector<MapPointId> landmarks(seen.landmark_of_feature.size());
  for (size_t i = 0; i < landmarks.size(); ++i) {
    if (seen.landmark_of_feature[i] == kNoLandmark || seen.is_outlier[i]) continue;
    const MapPointId id = PointOfLandmark(scene, seen.landmark_of_feature[i]);
    if (map.FindPoint(id) != nullptr) landmarks[i] = id;
  }
  return landmarks;
}

/// Features that were given a landmark which they do not show, or only by an outlier's location.
inline int CountWrongLandmarks(const SyntheticScene& scene, size_t view, const Map& map,
                               const std::vector<MapPointId>& landmarks) {
  const std::vector<MapPointId> truth = TrueLandmarks(scene, view, map);
  int wrong = 0;
  for (size_t i = 0; i < landmarks.size(); ++i) wrong += landmarks[i].IsValid() && landmarks[i] != truth[i] ? 1 : 0;
  return wrong;
}

}  // namespace portolan
