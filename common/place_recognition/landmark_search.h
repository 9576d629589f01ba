#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "map/keyframe.h"
#include "map/map_point.h"

namespace portolan {

struct LandmarkSearchOptions {
  double radius_px = 4.0;  ///< of the window around the predicted pixel, pixels of the predicted pyramid level
  int max_distance = 50;   ///< Hamming distance of a match, of 256 bits
  // Landmarks that a camera in the right place finds more often than not:
  double min_viewing_cosine = 0.9;  ///< seen from within 25 degrees of where they were seen from
  size_t min_observations = 3;      ///< by so many keyframes: established
};

/// A landmark that was found in an image.
struct FoundLandmark {
  size_t landmark = 0;   ///< index into the landmarks searched for
  uint32_t feature = 0;  ///< of the image
  int distance = 0;      ///< Hamming
  double error_px = 0;   ///< from the predicted pixel, pixels of the feature's pyramid level
};

/// How many of the landmarks expected in some part of the image were found there.
struct ExpectedLandmarks {
  int expected = 0, found = 0;

  double Share() const { return expected > 0 ? static_cast<double>(found) / expected : 0; }
};

struct LandmarkSearchResult {
  int visible = 0;                   ///< landmarks that the camera should see, were nothing in between
  std::vector<FoundLandmark> found;  ///< of those, one to one with features, in order of the landmarks
  ExpectedLandmarks expected;        ///< those of the visible ones that should be found (LandmarkSearchOptions)
  static constexpr int kColumns = 8, kRows = 6;
  std::array<ExpectedLandmarks, kColumns * kRows> cells{};  ///< the same by the image's cells

  /// Of the cells in which landmarks are expected (4 or more, to tell anything), the share where as large a part as
  /// min_share was found.
  double ShareOfCells(double min_share) const;
  /// Share of all cells in which a landmark was found.
  double Spread(const KeyFrameData& image) const;
};

/// Looks for landmarks of a map in an image whose camera is at camera_from_map (of that map): for each that should be
/// visible the nearest descriptor in a small window, within one octave of the predicted one. Of several landmarks at
/// one feature the closest descriptor wins. Derived fields of the landmarks must be up to date.
LandmarkSearchResult FindLandmarks(const std::vector<const MapPoint*>& landmarks, const Rigid3d& camera_from_map,
                                   const KeyFrameData& image, const LandmarkSearchOptions& options);

}  // namespace portolan
