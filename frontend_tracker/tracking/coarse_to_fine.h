#pragma once

#include <vector>

#include "map/map.h"
#include "optimization/pose_optimization.h"
#include "tracking/frame.h"
#include "tracking/local_map.h"
#include "tracking/tracker_options.h"

namespace portolan {

/// A landmark looked for in the first stage, and the feature by which the reference frame saw it.
struct ReferenceLandmark {
  MapPointId id;
  Eigen::Vector3d position_in_map = Eigen::Vector3d::Zero();
  Descriptor descriptor{};
  uint8_t octave = 0;
  float angle_rad = 0;
};

/// Landmarks of a tracked frame that still exist, for the coarse stage in the next one.
std::vector<ReferenceLandmark> ReferenceLandmarks(const Map& map, const KeyFrameData& data,
                                                  const std::vector<MapPointId>& landmarks);

/// Map-based tracking in two stages (paper Sec. 3.2). Works on a frame with a predicted pose; sets its pose, landmarks
/// and counts.
///
///   MapTracker tracker(options);
///   int n = tracker.TrackCoarse(map, reference, predicted_poses, &frame);
///   n = tracker.TrackFine(map, &frame);
class MapTracker {
 public:
  explicit MapTracker(const MapTrackingOptions& options) : options_(options) {}

  /// Coarse stage: looks for the reference's landmarks alone in windows of radius_px (at level 0) around where the
  /// predicted pose puts them, then motion-only BA. @return number of inliers n; 0 matches leave the frame with the
  /// prediction.
  int TrackCoarse(const Map& map, const std::vector<ReferenceLandmark>& reference,
                  const Rigid3d& predicted_camera_from_map, double radius_px, Frame* frame) const;
  /// The same from the first of several predictions by which enough of the reference's landmarks are found, else from
  /// the best; in wide windows too where no prediction finds more in the usual ones than a wrong one would.
  int TrackCoarse(const Map& map, const std::vector<ReferenceLandmark>& reference,
                  const std::vector<Rigid3d>& predictions, Frame* frame) const;

  /// Fine stage: adds landmarks of the local map that have no feature yet, in small windows if the coarse stage found
  /// enough and wider ones if not, then motion-only BA over all. Sets the frame's reference keyframe. @return number of
  /// inliers n.
  int TrackFine(const Map& map, Frame* frame);

  const LocalMap& local_map() const { return local_map_; }
  void Reset() { local_map_.Clear(); }

 private:
  void AddLocalLandmarks(double radius_px, Frame* frame) const;

  MapTrackingOptions options_;
  LocalMap local_map_;
};

/// Motion-only BA (paper Sec. 3.2) of a frame over its landmarks; sets its pose and its counts n and m, and takes
/// outliers out of it. @return n.
int OptimizeFramePose(const Map& map, Frame* frame, const PoseOptimizationOptions& options = {});

/// Whether a frame counts as tracked: enough landmarks agree with its pose, and more of those matched than would with a
/// wrong one.
bool IsFound(const Frame& frame, const TrackerOptions& options);

}  // namespace portolan
