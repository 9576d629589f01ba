#include "map/keyframe_landmarks.h"

#include <algorithm>

#include "base/check.h"

namespace portolan {

MapPointId KeyFrameLandmarks::operator[](size_t feature) const {
  const auto place = std::lower_bound(features_.begin(), features_.end(), feature);
  const bool is_landmark = place != features_.end() && *place == feature;
  return is_landmark ? landmarks_[static_cast<size_t>(place - features_.begin())] : MapPointId();
}

void KeyFrameLandmarks::Set(size_t feature, MapPointId landmark) {
  PORTOLAN_CHECK(feature < num_features_) << "feature " << feature << " of " << num_features_;
  const auto place = std::lower_bound(features_.begin(), features_.end(), feature);
  const auto landmark_place = landmarks_.begin() + (place - features_.begin());
  const bool was_landmark = place != features_.end() && *place == feature;
  if (was_landmark && landmark.IsValid()) {
    *landmark_place = landmark;
  } else if (was_landmark) {
    features_.erase(place);
    landmarks_.erase(landmark_place);
  } else if (landmark.IsValid()) {
    features_.insert(place, static_cast<uint32_t>(feature));
    landmarks_.insert(landmark_place, landmark);
  }
}

std::vector<MapPointId> KeyFrameLandmarks::ByFeature() const {
  std::vector<MapPointId> by_feature(num_features_);
  for (size_t k = 0; k < features_.size(); ++k) by_feature[features_[k]] = landmarks_[k];
  return by_feature;
}

}  // namespace portolan
