#pragma once

#include "geometry/sim3.h"
#include "map/map.h"
#include "testing/synthetic_scene.h"

namespace portolan {

struct MapBuilderOptions {
  int num_keyframes = 0;  ///< of the scene's first views; 0: all
  MapId map{0, 1, 1};
  Epoch epoch = 1;
  int min_observations = 2;    ///< landmarks seen by fewer keyframes stay out
  bool keep_outliers = false;  ///< whether features of a wrong location are observations too
  Sim3d map_from_world;        ///< the map's own frame and scale
  /// Noise on the poses of all but the first camera: of the translation, map units, and the rotation, rad.
  double pose_sigma = 0;
  double point_sigma = 0;  ///< noise on points, map units
  uint64_t seed = 1;
};

/// A valid map of a scene: keyframes are the views' data in order, each hanging on the one before; points are the
/// landmarks, with ids of sequence landmark + 1. Changes are pending: TakeDelta() gives the whole map.
Map BuildMap(const SyntheticScene& scene, const MapBuilderOptions& options = MapBuilderOptions());

/// Id of a landmark's point in maps of BuildMap.
MapPointId PointOfLandmark(const SyntheticScene& scene, int landmark);

/// Finds the data of the scene's views, for Map::Apply. The scene must outlive it.
Map::FindData DataOf(const SyntheticScene& scene);

}  // namespace portolan
