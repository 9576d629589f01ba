#include "tracking/backfill.h"

#include <iterator>
#include <utility>

namespace portolan {

Backfill::Backfill(const TrackerOptions& options, const PinholeCamera& camera)
    : options_(options.map_tracking), min_inliers_(options.min_tracked_points), rotation_estimator_(camera) {}

void Backfill::Start(Frame first, std::vector<Frame> between) {
  last_ = std::move(first);
  between_.assign(std::make_move_iterator(between.begin()), std::make_move_iterator(between.end()));
}

Rigid3d Backfill::PredictPose(const Frame& frame) const {
  const Rigid3d& last = last_.camera_from_map;
  if (last_.small.values.empty()) return last;  // ESM is off
  const auto turn = rotation_estimator_.EstimateRotation(last_.small, frame.small, Eigen::Quaterniond::Identity());
  if (!turn.ok) return last;
  const Eigen::Quaterniond rotation = (turn.current_from_reference * last.rotation).normalized();
  return Rigid3d(rotation, -(rotation * last.TargetOriginInSource()));
}

std::optional<Frame> Backfill::Next(const Map& map) {
  if (between_.empty()) return std::nullopt;
  Frame frame = std::move(between_.front());
  between_.pop_front();
  MapTracker tracker(options_);
  const auto reference = ReferenceLandmarks(map, *last_.data, last_.landmarks);
  if (tracker.TrackCoarse(map, reference, PredictPose(frame), options_.wide_radius_px, &frame) < options_.min_points ||
      tracker.TrackFine(map, &frame) < min_inliers_) {
    return std::nullopt;
  }
  last_ = frame;
  return frame;
}

}  // namespace portolan
