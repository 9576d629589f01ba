#pragma once

#include <utility>
#include <vector>

#include "base/ids.h"
#include "map/map.h"
#include "optimization/bundle_adjustment.h"

namespace portolan {

/// The part of a map that a bundle adjustment works on.
struct BundleWindow {
  std::vector<KeyFrameId> free;    ///< their poses change
  std::vector<KeyFrameId> fixed;   ///< their poses hold the window in place
  std::vector<MapPointId> points;  ///< that take part; of their measurements, those in these keyframes
};

/// A window as a problem, and what its parts are in the map. Poses are the window's free keyframes, then its fixed
/// ones.
struct WindowProblem {
  BundleProblem problem;
  std::vector<MapPointId> points;                          ///< of the problem's points
  std::vector<std::pair<MapPointId, KeyFrameId>> sources;  ///< of the measurements
};

/// Points that fewer than two keyframes of the window see are left out: nothing would hold their depth.
WindowProblem MakeWindowProblem(const Map& map, const BundleWindow& window);

/// Puts a solution into the map: poses and positions that changed noticeably, so that deltas stay small.
void TakeSolution(const BundleWindow& window, const WindowProblem& solved, Map* map);

/// Removes observations with gross errors at the solution (squared normalised error above chi2), and points that they
/// leave without two. @return how many observations.
int RemoveOutliers(const WindowProblem& solved, double chi2, Map* map);

}  // namespace portolan
