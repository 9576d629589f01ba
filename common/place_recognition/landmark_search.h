#pragma once

#include <cstdint>
#include <vector>

#include "map/keyframe.h"
#include "map/map_point.h"

namespace portolan {

struct LandmarkSearchOptions {
  double radius_px = 4.0;  ///< of the window around the predicted pixel, pixels of the predicted pyramid level
  int max_distance = 50;   ///< Hamming distance of a match, of 256 bits
};

/// A landmark that was found in an image.
struct FoundLandmark {
  size_t landmark = 0;   ///< index into the landmarks searched for
  uint32_t feature = 0;  ///< of the image
  int distance = 0;      ///< Hamming
  double error_px = 0;   ///< from the predicted pixel, pixels of the feature's pyramid level
};

struct LandmarkSearchResult {
  int visible = 0;                   ///< landmarks that the camera should see, were nothing in between
  std::vector<FoundLandmark> found;  ///< of those, one to one with features, in order of the landmarks

  double Share() const { return visible > 0 ? static_cast<double>(found.size()) / visible : 0; }
};

/// Looks for landmarks of a map in an image whose camera is at camera_from_map (of that map): for each that should be
/// visible the nearest descriptor in a small window, within one octave of the predicted one. Of several landmarks at one
/// feature the closest descriptor wins. Derived fields of the landmarks must be up to date.
LandmarkSearchResult FindLandmarks(const std::vector<const MapPoint*>& landmarks, const Rigid3d& camera_from_map,
                                   const KeyFrameData& image, const LandmarkSearchOptions& options);

}  // namespace portolan
