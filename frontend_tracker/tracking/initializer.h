#pragma once

#include <optional>
#include <utility>
#include <vector>

#include "tracking/frame.h"
#include "tracking/tracker_options.h"

namespace portolan {

/// Image motion that a pair needs for this camera, in pixels: options.min_baseline_px, or less.
double RequiredBaseline(const InitializerOptions& options, const PinholeCamera& camera);

/// Chooses the two frames from which a new map is made (paper Sec. 4.1, first step): enough matches, and enough image
/// motion once the rotation is compensated. The mapper makes the map of them, or refuses them: then further frames are
/// offered against the same first one.
class Initializer {
 public:
  explicit Initializer(const InitializerOptions& options) : options_(options) {}

  /// A chosen pair.
  struct Pair {
    Frame first, second;
    std::vector<std::pair<uint32_t, uint32_t>> matches;                     ///< (feature of first, feature of second)
    Eigen::Quaterniond second_from_first = Eigen::Quaterniond::Identity();  ///< rotation, by ESM
    /// Of second_from_first, where both are tracked in another map; 0: unknown.
    Eigen::Vector3d translation = Eigen::Vector3d::Zero();
    double baseline_px = 0;  ///< median image motion without the rotation
  };

  /// @param current_from_last rotation since the frame offered before (identity for the first).
  std::optional<Pair> Offer(const Frame& frame, const Eigen::Quaterniond& current_from_last);

  void Reset() { first_.reset(); }
  bool has_first() const { return first_.has_value(); }
  size_t num_matches() const { return num_matches_; }
  double baseline_px() const { return baseline_px_; }

 private:
  void SetFirst(const Frame& frame);
  std::vector<Eigen::Vector2d> PredictPixels(const PinholeCamera& camera) const;

  InitializerOptions options_;
  std::optional<Frame> first_;
  Eigen::Quaterniond current_from_first_ = Eigen::Quaterniond::Identity();
  // Per feature of the first frame: motion beyond the rotation, as last seen; NaN once lost.
  std::vector<Eigen::Vector2d> flow_px_;
  size_t num_matches_ = 0;
  double baseline_px_ = 0;
  int frames_since_first_ = 0;
};

}  // namespace portolan
