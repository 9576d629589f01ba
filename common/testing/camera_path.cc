#include "testing/camera_path.h"

#include <algorithm>
#include <cmath>

#include "base/check.h"

namespace portolan {
namespace {

constexpr double kRoadStep = 0.02;      // m between points of a road before it is timed
constexpr double kRoadInterval = 0.15;  // s between stances on a road: four to a step of the walker
constexpr double kBrakingLength = 4.0;  // m over which the speed changes before and after a corner

struct RoadPoint {
  Eigen::Vector2d position;
  double yaw;
  bool in_corner;
};

void AppendStraight(const Eigen::Vector2d& from, const Eigen::Vector2d& to, std::vector<RoadPoint>* road) {
  const Eigen::Vector2d along = to - from;
  const double yaw = std::atan2(along.y(), along.x());
  const int steps = std::max(1, static_cast<int>(along.norm() / kRoadStep));
  for (int i = 0; i < steps; ++i) road->push_back({from + along * i / steps, yaw, false});
}

/// An arc that starts at `from` in direction `unit` and turns by `turn` (left is positive).
void AppendArc(const Eigen::Vector2d& from, const Eigen::Vector2d& unit, double turn, double radius,
               std::vector<RoadPoint>* road) {
  const Eigen::Vector2d left(-unit.y(), unit.x());
  const double side = turn < 0 ? -1.0 : 1.0;
  const double yaw = std::atan2(unit.y(), unit.x());
  const int steps = std::max(1, static_cast<int>(radius * std::abs(turn) / kRoadStep));
  for (int i = 0; i < steps; ++i) {
    const double angle = std::abs(turn) * i / steps;
    const Eigen::Vector2d position = from + radius * (std::sin(angle) * unit + side * (1 - std::cos(angle)) * left);
    road->push_back({position, yaw + side * angle, true});
  }
}

std::vector<RoadPoint> RoundCorners(const std::vector<Eigen::Vector2d>& corners, double radius) {
  std::vector<RoadPoint> road;
  Eigen::Vector2d at = corners[0];
  for (size_t i = 1; i + 1 < corners.size(); ++i) {
    const Eigen::Vector2d in = (corners[i] - corners[i - 1]).normalized();
    const Eigen::Vector2d out = (corners[i + 1] - corners[i]).normalized();
    const double turn = std::atan2(in.x() * out.y() - in.y() * out.x(), in.dot(out));
    const double cut = radius * std::tan(std::abs(turn) / 2);  // of each leg
    PORTOLAN_CHECK((corners[i] - at).dot(in) > cut) << " the leg before corner " << i << " of a road is too short";
    AppendStraight(at, corners[i] - cut * in, &road);
    AppendArc(corners[i] - cut * in, in, turn, radius, &road);
    at = corners[i] + cut * out;
  }
  AppendStraight(at, corners.back(), &road);
  return road;
}

/// Speed at each road point: the corner's within corners, rising linearly to the straight's over the braking length.
std::vector<double> SpeedProfile(const std::vector<RoadPoint>& road, const RoadOptions& options) {
  const double rise = (options.speed - options.corner_speed) / kBrakingLength * kRoadStep;
  std::vector<double> speed(road.size());
  double limit = options.speed;
  for (size_t i = 0; i < road.size(); ++i) {
    limit = road[i].in_corner ? options.corner_speed : std::min(options.speed, limit + rise);
    speed[i] = limit;
  }
  limit = options.speed;
  for (size_t i = road.size(); i-- > 0;) {
    limit = road[i].in_corner ? options.corner_speed : std::min(options.speed, limit + rise);
    speed[i] = std::min(speed[i], limit);
  }
  return speed;
}

CameraStance Sway(const RoadPoint& point, double t_s, const RoadOptions& options) {
  constexpr double kGlancePeriod = 7.0;  // s, no multiple of a lap's
  const double step = 2 * M_PI * options.sway_hz * t_s;
  const Eigen::Vector2d left(-std::sin(point.yaw), std::cos(point.yaw));
  const Eigen::Vector2d position = point.position + 0.5 * options.sway * std::sin(step / 2) * left;
  CameraStance stance;
  stance.position_in_world = {position.x(), position.y(), options.camera_height + options.sway * std::sin(step)};
  stance.yaw = point.yaw + options.glance * std::sin(2 * M_PI * t_s / kGlancePeriod);
  stance.pitch = options.pitch + 0.2 * options.sway * std::cos(step);
  stance.roll = 0.2 * options.sway * std::sin(step / 2);
  return stance;
}

/// a + (b - a) reduced to the nearest turn.
double UnwrapAngle(double a, double b) {
  return a + std::remainder(b - a, 2 * M_PI);
}

}  // namespace

Rigid3d WorldFromCamera(const CameraStance& stance) {
  Eigen::Matrix3d forward_left_up_from_camera;
  forward_left_up_from_camera << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  const Eigen::Quaterniond rotation(Eigen::AngleAxisd(stance.yaw, Eigen::Vector3d::UnitZ()) *
                                    Eigen::AngleAxisd(-stance.pitch, Eigen::Vector3d::UnitY()) *
                                    Eigen::AngleAxisd(stance.roll, Eigen::Vector3d::UnitX()));
  return Rigid3d((rotation * Eigen::Quaterniond(forward_left_up_from_camera)).normalized(), stance.position_in_world);
}

CameraPath::CameraPath(std::vector<CameraStance> stances, double interval_s)
    : stances_(std::move(stances)), interval_s_(interval_s) {
  PORTOLAN_CHECK(stances_.size() >= 2 && interval_s > 0) << stances_.size() << " stances, " << interval_s << " s apart";
  for (size_t i = 1; i < stances_.size(); ++i) stances_[i].yaw = UnwrapAngle(stances_[i - 1].yaw, stances_[i].yaw);
}

CameraStance CameraPath::Stance(int64_t i) const {
  const int64_t last = static_cast<int64_t>(stances_.size()) - 1;
  if (i >= 0 && i <= last) return stances_[static_cast<size_t>(i)];
  // Beyond its ends the path goes on as it came, so that it neither starts nor stops with a jerk.
  const CameraStance& end = i < 0 ? stances_.front() : stances_.back();
  const CameraStance& inner = i < 0 ? stances_[1] : stances_[static_cast<size_t>(last) - 1];
  return {2 * end.position_in_world - inner.position_in_world, 2 * end.yaw - inner.yaw, 2 * end.pitch - inner.pitch,
          2 * end.roll - inner.roll};
}

Rigid3d CameraPath::At(double t_s) const {
  const double at = std::clamp(t_s, 0.0, duration_s()) / interval_s_;
  const int64_t i = static_cast<int64_t>(at);
  const double f = at - static_cast<double>(i), g = 1 - f;
  // The uniform cubic B-spline's basis (de Boor 1978).
  const double weights[4] = {g * g * g / 6, (3 * f * f * f - 6 * f * f + 4) / 6, (3 * g * g * g - 6 * g * g + 4) / 6,
                             f * f * f / 6};
  CameraStance sum;
  for (int64_t k = 0; k < 4; ++k) {
    const CameraStance stance = Stance(std::min(i + k - 1, static_cast<int64_t>(stances_.size())));
    sum.position_in_world += weights[k] * stance.position_in_world;
    sum.yaw += weights[k] * stance.yaw;
    sum.pitch += weights[k] * stance.pitch;
    sum.roll += weights[k] * stance.roll;
  }
  return WorldFromCamera(sum);
}

CameraPath MakeRoadPath(const std::vector<Eigen::Vector2d>& corners_in_world, const RoadOptions& options) {
  PORTOLAN_CHECK(corners_in_world.size() >= 2 && options.speed > 0 && options.corner_speed > 0);
  const std::vector<RoadPoint> road = RoundCorners(corners_in_world, options.corner_radius);
  const std::vector<double> speed = SpeedProfile(road, options);
  std::vector<CameraStance> stances;
  double t_s = 0;
  for (size_t i = 0; i < road.size(); ++i) {
    if (t_s >= kRoadInterval * static_cast<double>(stances.size())) stances.push_back(Sway(road[i], t_s, options));
    t_s += kRoadStep / speed[i];
  }
  return CameraPath(std::move(stances), kRoadInterval);
}

}  // namespace portolan
