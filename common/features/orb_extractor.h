#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "base/result.h"
#include "features/feature_set.h"
#include "geometry/camera_model.h"

namespace portolan {

struct OrbOptions {
  int num_features = 2000;  ///< aimed at, per image (paper Sec. 7.1)
  ScalePyramid pyramid;
  int fast_threshold = 20;     ///< grey levels; where a cell is empty at it, ...
  int min_fast_threshold = 7;  ///< ... this one is tried
  int cell_px = 35;            ///< side of a detection cell at each level
  bool subpixel = true;        ///< refine locations by a parabola over the corner response
  int threads = 1;             ///< that share an image's levels; what is found does not depend on it

  Status Check() const;  ///< ranges of each field; the message names the key
};

/// Oriented multi-scale FAST corners with rotated BRIEF descriptors (Rublee et al., ICCV 2011), spread evenly over the
/// image. Deterministic. Keeps its pyramid buffers between calls: one object per thread.
///
///   OrbExtractor extractor(options);
///   FeatureSet features = extractor.Extract(grey, camera);
class OrbExtractor {
 public:
  explicit OrbExtractor(const OrbOptions& options);
  ~OrbExtractor();

  /// @param grey CV_8UC1 of the camera's size, any content. @return features with locations undistorted by the camera;
  /// those without an ideal pixel or outside the ideal image are left out.
  FeatureSet Extract(const cv::Mat& grey, const CameraModel& camera);

 private:
  struct Level;
  void BuildPyramid(const cv::Mat& grey);
  template <class Work>
  void ForEachLevel(const Work& work);
  void SelectCorners();
  void Describe(Level* level) const;
  FeatureSet Undistort(const CameraModel& camera) const;

  OrbOptions options_;
  std::vector<Level> levels_;  ///< finest first
};

}  // namespace portolan
