#pragma once

#include "base/time.h"
#include "geometry/rigid3.h"
#include "geometry/sim3.h"

namespace portolan {

/// The decaying velocity motion model (paper Eq. 1, 2): predicts the next camera pose from the last two, on the
/// assumption that a robot's camera moves smoothly, slows down and stops in the end.
class VelocityModel {
 public:
  /// @param decaying false: constant velocity, that between the last two poses, which the paper's Table 2 compares
  /// with.
  explicit VelocityModel(bool decaying = true) : decaying_(decaying) {}

  /// Forgets everything: the next prediction is the pose given then.
  void Reset();

  /// Takes in the pose of a tracked frame. A gap in time of more than kMaxGapSeconds restarts the model.
  void Update(Timestamp stamp, const Rigid3d& camera_from_map);

  /// The map moved under the camera (see MapMotion): pose and velocity stay what they are in the scene.
  void MoveWithMap(const Sim3d& new_from_old);

  /// camera_from_map at `stamp`; the last pose if there is no velocity yet. Only after an Update().
  Rigid3d Predict(Timestamp stamp) const;

  bool has_pose() const { return has_pose_; }
  const Rigid3d& last_camera_from_map() const { return last_camera_from_map_; }
  Timestamp last_stamp() const { return last_stamp_; }
  /// Twist per second, camera frame.
  const Vector6d& velocity() const { return velocity_; }

 private:
  static constexpr double kDamping = 0.9;        // paper Eq. (1)
  static constexpr double kMaxGapSeconds = 2.0;  // after it a velocity tells nothing any more

  bool decaying_;
  bool has_pose_ = false;
  bool has_velocity_ = false;
  Timestamp last_stamp_;
  Rigid3d last_camera_from_map_;
  Vector6d velocity_ = Vector6d::Zero();
};

}  // namespace portolan
