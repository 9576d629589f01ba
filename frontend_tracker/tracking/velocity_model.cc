#include "tracking/velocity_model.h"

#include "base/check.h"

namespace portolan {

void VelocityModel::Reset() {
  *this = VelocityModel(decaying_);
}

void VelocityModel::Update(Timestamp stamp, const Rigid3d& camera_from_map) {
  const double dt = SecondsBetween(last_stamp_, stamp);
  if (has_pose_ && dt > 0 && dt < kMaxGapSeconds) {
    const Vector6d instantaneous = LogSE3(camera_from_map * last_camera_from_map_.Inverse()) / dt;
    if (!decaying_) {
      velocity_ = instantaneous;
    } else if (has_velocity_) {
      velocity_ = kDamping * (velocity_ + instantaneous) / 2.0;  // paper Eq. (1)
    } else {
      velocity_ = kDamping * instantaneous;  // the first has none before it to be averaged with
    }
    has_velocity_ = true;
  } else {
    velocity_.setZero();
    has_velocity_ = false;
  }
  has_pose_ = true;
  last_stamp_ = stamp;
  last_camera_from_map_ = camera_from_map;
}

void VelocityModel::MoveWithMap(const Sim3d& new_from_old) {
  last_camera_from_map_ = TransformPose(last_camera_from_map_, new_from_old);
  velocity_.head<3>() *= new_from_old.scale;  // a twist of the camera's own frame: lengths alone change
}

Rigid3d VelocityModel::Predict(Timestamp stamp) const {
  PORTOLAN_CHECK(has_pose_) << "a prediction needs a pose";
  const double dt = SecondsBetween(last_stamp_, stamp);
  if (!has_velocity_ || dt <= 0 || dt > kMaxGapSeconds) return last_camera_from_map_;
  return ExpSE3(dt * velocity_) * last_camera_from_map_;  // paper Eq. (2)
}

}  // namespace portolan
