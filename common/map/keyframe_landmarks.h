#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/ids.h"

namespace portolan {

/// Which of a keyframe's features are landmarks. Kept as sorted lists of those that are: some hundred of two thousand.
///
///   for (const MapPointId landmark : keyframe.landmarks) ...      // all of them, by feature
///   const MapPointId landmark = keyframe.landmarks[feature];      // none where the feature is no landmark
class KeyFrameLandmarks {
 public:
  explicit KeyFrameLandmarks(size_t num_features = 0) : num_features_(num_features) {}

  /// Of the keyframe, landmarks or not.
  size_t num_features() const { return num_features_; }

  /// @param feature below num_features(). Time grows with the logarithm of the number of landmarks: loops over all
  /// features are faster on ByFeature().
  MapPointId operator[](size_t feature) const;
  /// Makes the feature this landmark, or none.
  void Set(size_t feature, MapPointId landmark);

  std::vector<MapPointId>::const_iterator begin() const { return landmarks_.begin(); }
  std::vector<MapPointId>::const_iterator end() const { return landmarks_.end(); }

  /// One per feature, none where the feature is no landmark.
  std::vector<MapPointId> ByFeature() const;

 private:
  size_t num_features_;
  std::vector<uint32_t> features_;     // ascending
  std::vector<MapPointId> landmarks_;  // of features_, all valid
};

}  // namespace portolan
