#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "base/ids.h"
#include "base/time.h"
#include "features/feature_grid.h"
#include "features/feature_matcher.h"
#include "features/feature_set.h"
#include "geometry/camera_model.h"
#include "geometry/rigid3.h"
#include "map/keyframe_landmarks.h"
#include "vocabulary/vocabulary.h"

namespace portolan {

/// What a keyframe saw. Never changes after it is made: published once, shared by every replica. In a map whose
/// camera's residual became known later it is replaced by WithResidual(), in every replica alike (within a step of the
/// wire where one missed an earlier residual: locations are rounded each time).
struct KeyFrameData {
  KeyFrameId id;
  Timestamp stamp;          ///< of the image, camera's clock
  uint64_t frame = 0;       ///< number of the image in its source, from 0
  PinholeCamera camera;     ///< the ideal camera of the undistorted features
  RadialResidual residual;  ///< of the calibration, that was taken out of the features, too
  ScalePyramid pyramid;
  FeatureSet features;

  // Derived from the above and the vocabulary by MakeKeyFrameData; not sent.
  FeatureGrid grid;
  BowVector bow;
  NodeFeatures nodes;  ///< direct index
};

/// Level above the leaves of the direct index (paper Sec. 2: "same node at a medium level"): with L = 5, k = 10 about
/// 1000 nodes.
constexpr int kDirectIndexLevel = 2;

/// Fills in grid, bow and nodes. @param vocabulary may be null: bow and nodes stay empty (tests of geometry alone).
std::shared_ptr<const KeyFrameData> MakeKeyFrameData(KeyFrameData data, const Vocabulary* vocabulary);

/// The keyframe's bag for a KeyFrameIndex, which keeps the data alive for as long as it is indexed.
inline std::shared_ptr<const BowVector> WordsOf(const std::shared_ptr<const KeyFrameData>& data) {
  return {data, &data->bow};
}

/// The data without orientations and descriptors, four fifths of its bytes, and without what is derived: enough to
/// follow the map it is in and to know its points' distances, for a replica that matches nothing.
std::shared_ptr<const KeyFrameData> WithoutAppearance(const KeyFrameData& data);

/// The keyframe as it is once `residual` is taken out of its features in place of its own: the data itself if that is
/// its own. What comes to lie outside the image moves to its edge. Locations are steps of the wire again
/// (feature_quantization.h). Deterministic.
std::shared_ptr<const KeyFrameData> WithResidual(const std::shared_ptr<const KeyFrameData>& data,
                                                 const RadialResidual& residual);

/// A keyframe in a map: shared data and small changing state.
struct KeyFrame {
  std::shared_ptr<const KeyFrameData> data;
  Rigid3d camera_from_map;
  KeyFrameId parent;            ///< in the spanning tree; none for the map's first keyframe
  KeyFrameLandmarks landmarks;  ///< mirrors the points' observations
};

}  // namespace portolan
