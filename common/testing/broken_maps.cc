#include "testing/broken_maps.h"

#include <cmath>
#include <functional>
#include <limits>

#include "base/check.h"
#include "testing/map_builder.h"

namespace portolan {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

/// A sequence number above any that builders use.
constexpr uint32_t kUnusedSequence = 0xfffff0;

uint32_t FreeFeature(const KeyFrameLandmarks& landmarks) {
  for (uint32_t i = 0; i < landmarks.num_features(); ++i) {
    if (!landmarks[i].IsValid()) return i;
  }
  PORTOLAN_CHECK(false) << " no feature is free: the scene has no clutter";
  return 0;
}

uint32_t TakenFeature(const KeyFrameLandmarks& landmarks) {
  for (uint32_t i = 0; i < landmarks.num_features(); ++i) {
    if (landmarks[i].IsValid()) return i;
  }
  PORTOLAN_CHECK(false) << " no feature is a landmark";
  return 0;
}

}  // namespace

MapDelta MakeGoodDelta(const Map& map, const SyntheticScene& scene, size_t next_view) {
  PORTOLAN_CHECK(map.keyframes().size() >= 2 && map.revision() > 0);
  const SyntheticView& next = scene.views.at(next_view);
  const KeyFrame& last = map.keyframes().rbegin()->second;
  const MapPointId moved = map.SortedPointIds().front();
  const MapPointId added(scene.options.robot, scene.options.session, kUnusedSequence);
  MapDelta delta;
  delta.map = map.id();
  delta.epoch = map.epoch();
  delta.base_revision = map.revision();
  delta.revision = map.revision() + 1;
  delta.keyframes.push_back(
      {last.data->id, last.camera_from_map, last.parent, static_cast<uint32_t>(last.landmarks.num_features())});
  delta.keyframes.push_back(
      {next.data->id, next.camera_from_world, last.data->id, static_cast<uint32_t>(next.data->features.size())});
  delta.points.push_back({moved, map.point(moved).position_in_map + Eigen::Vector3f(0.01f, 0, 0)});
  delta.points.push_back({added, Eigen::Vector3f(0, 0, static_cast<float>(scene.options.depth))});
  delta.observations.push_back({added, last.data->id, static_cast<int32_t>(FreeFeature(last.landmarks))});
  delta.observations.push_back({added, next.data->id, 0});
  return delta;
}

std::vector<BrokenDelta> MakeBrokenDeltas(const Map& map, const SyntheticScene& scene, size_t next_view) {
  const MapDelta good = MakeGoodDelta(map, scene, next_view);
  const KeyFrame& last = map.keyframes().rbegin()->second;
  const auto num_features = static_cast<int32_t>(last.landmarks.num_features());
  const KeyFrameId unknown_keyframe(scene.options.robot, scene.options.session, kUnusedSequence);
  const MapPointId unknown_point(scene.options.robot, scene.options.session, kUnusedSequence + 1);
  const MapPointId moved = good.points[0].id;
  std::vector<BrokenDelta> broken;
  const auto add = [&](const std::string& name, const std::function<void(MapDelta*)>& change) {
    broken.push_back({name, good});
    change(&broken.back().delta);
  };
  add("of another map", [&](MapDelta* d) { d->map = MapId(map.id().value + 1); });
  add("from a later revision", [](MapDelta* d) { ++d->base_revision, ++d->revision; });
  add("keyframe without an id", [](MapDelta* d) { d->keyframes[1].id = KeyFrameId(); });
  add("keyframe data missing",
      [&](MapDelta* d) { d->keyframes[1].id = d->observations[1].keyframe = unknown_keyframe; });
  add("keyframe with another number of features", [](MapDelta* d) { ++d->keyframes[1].num_features; });
  add("parent unknown", [&](MapDelta* d) { d->keyframes[1].parent = unknown_keyframe; });
  add("pose not finite", [](MapDelta* d) { d->keyframes[1].camera_from_map.translation.x() = kNaN; });
  add("rotation not finite", [](MapDelta* d) { d->keyframes[0].camera_from_map.rotation.x() = kNaN; });
  add("rotation not a unit quaternion", [](MapDelta* d) { d->keyframes[0].camera_from_map.rotation.coeffs() *= 2; });
  add("point without an id",
      [](MapDelta* d) { d->points[1].id = d->observations[0].point = d->observations[1].point = MapPointId(); });
  add("point not finite",
      [](MapDelta* d) { d->points[0].position_in_map.z() = std::numeric_limits<float>::infinity(); });
  add("observed point unknown", [&](MapDelta* d) { d->observations[0].point = unknown_point; });
  add("observed point removed", [&](MapDelta* d) {
    d->removed_points.push_back({moved, MapPointId()});
    d->points.erase(d->points.begin());
    d->observations[0].point = moved;
  });
  add("observing keyframe unknown", [&](MapDelta* d) { d->observations[0].keyframe = unknown_keyframe; });
  add("feature out of range", [&](MapDelta* d) { d->observations[0].feature = num_features; });
  add("feature below -1", [](MapDelta* d) { d->observations[0].feature = -2; });
  add("feature taken by another point",
      [&](MapDelta* d) { d->observations[0].feature = static_cast<int32_t>(TakenFeature(last.landmarks)); });
  add("removed keyframe's pose not finite", [&](MapDelta* d) {
    d->removed_keyframes.push_back(
        {unknown_keyframe, last.data->id, Rigid3d(Eigen::Quaterniond::Identity(), {kNaN, 0, 0})});
  });
  return broken;
}

std::vector<BrokenMap> MakeBrokenMaps(const SyntheticScene& scene) {
  MapBuilderOptions options;
  options.num_keyframes = 3;
  const Map good = BuildMap(scene, options);
  const KeyFrameId first = scene.views[0].data->id, second = scene.views[1].data->id, third = scene.views[2].data->id;
  const MapPointId some_point = good.SortedPointIds().front();
  std::vector<BrokenMap> broken;
  const auto add = [&](const std::string& name, const std::string& objection, const std::function<void(Map*)>& change) {
    broken.push_back({name, good, objection});
    change(&broken.back().map);
  };
  add("point seen once", "fewer than two", [&](Map* map) {
    while (map->point(some_point).observations.size() > 1) {
      map->RemoveObservation(some_point, map->point(some_point).observations.back().keyframe);
    }
  });
  add("two roots", "2 roots", [&](Map* map) { map->SetParent(third, KeyFrameId()); });
  add("no root", "0 roots", [&](Map* map) { map->SetParent(first, third); });
  add("circle of parents", "circle", [&](Map* map) { map->SetParent(second, third); });
  add("parent unknown", "unknown parent", [&](Map* map) {
    map->SetParent(third, KeyFrameId(scene.options.robot, scene.options.session, kUnusedSequence));
  });
  add("pose not finite", "pose", [&](Map* map) {
    map->SetPose(second, Rigid3d(Eigen::Quaterniond::Identity(), {0, kNaN, 0}));
  });
  add("rotation not a unit quaternion", "pose", [&](Map* map) {
    Rigid3d pose = map->keyframe(second).camera_from_map;
    pose.rotation.coeffs() *= 1.01;
    map->SetPose(second, pose);
  });
  return broken;
}

}  // namespace portolan
