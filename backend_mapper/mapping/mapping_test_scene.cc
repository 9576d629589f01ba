#include "mapping/mapping_test_scene.h"

#include <algorithm>
#include <cmath>
#include <map>

namespace portolan {
namespace {

constexpr double kFocalPx = 500;
constexpr int kWidth = 640, kHeight = 480;
// A point shows at octave 0 from this far away.
constexpr double kFullDistance = 14;

Descriptor RandomDescriptor(Random* random) {
  return {random->Next(), random->Next(), random->Next(), random->Next()};
}

void AddFeature(const Eigen::Vector2d& pixel_px, int octave, const Descriptor& descriptor, FeatureSet* features) {
  features->pixels_px.push_back(pixel_px.cast<float>());
  features->octaves.push_back(static_cast<uint8_t>(octave));
  features->angles_rad.push_back(0);
  features->descriptors.push_back(descriptor);
}

}  // namespace

TestScene::TestScene(const TestSceneOptions& options) : options_(options), random_(options.seed) {
  camera_.fx = camera_.fy = kFocalPx;
  camera_.cx = kWidth / 2.0;
  camera_.cy = kHeight / 2.0;
  camera_.width = kWidth;
  camera_.height = kHeight;
  for (int i = 0; i < options.num_points; ++i) {
    Eigen::Vector3d point(random_.Uniform(-6, 10), random_.Uniform(-4, 4), random_.Uniform(4, 10));
    if (options.planar) point.z() = 7 + 0.2 * point.x() + 0.1 * point.y();
    points_in_map_.push_back(point);
    descriptors_.push_back(RandomDescriptor(&random_));
  }
}

TestView TestScene::See(const Rigid3d& camera_from_map) {
  TestView view;
  view.camera_from_map = camera_from_map;
  KeyFrameData data;
  data.id = KeyFrameId(1, 1, ++views_);
  data.frame = views_;
  data.stamp = Timestamp{int64_t{views_} * 100000000};
  data.camera = camera_;
  for (size_t i = 0; i < points_in_map_.size(); ++i) {
    const Eigen::Vector3d in_camera = camera_from_map * points_in_map_[i];
    if (in_camera.z() < 0.5) continue;
    const double octave = std::log(kFullDistance / in_camera.norm()) / std::log(data.pyramid.factor);
    const int level = std::clamp(static_cast<int>(std::lround(octave)), 0, data.pyramid.levels - 1);
    const double sigma = options_.pixel_sigma * data.pyramid.Scale(level);
    const Eigen::Vector2d noise(sigma * random_.Gaussian(), sigma * random_.Gaussian());
    const Eigen::Vector2d pixel_px = camera_.Project(in_camera) + noise;
    if (!camera_.Contains(pixel_px)) continue;
    Descriptor descriptor = descriptors_[i];
    for (int b = 0; b < options_.flipped_bits; ++b) descriptor[random_.Below(4)] ^= uint64_t{1} << random_.Below(64);
    AddFeature(pixel_px, level, descriptor, &data.features);
    view.points.push_back(static_cast<int>(i));
  }
  for (int i = 0; i < options_.clutter; ++i) {
    const Eigen::Vector2d pixel_px(random_.Uniform(0, kWidth - 1), random_.Uniform(0, kHeight - 1));
    AddFeature(pixel_px, static_cast<int>(random_.Below(8)), RandomDescriptor(&random_), &data.features);
    view.points.push_back(-1);
  }
  view.data = MakeKeyFrameData(std::move(data), nullptr);
  return view;
}

Rigid3d CameraAt(const Eigen::Vector3d& centre_in_map, const Eigen::Vector3d& turn) {
  const Eigen::Quaterniond rotation = ExpSO3(turn);
  return Rigid3d(rotation, -(rotation * centre_in_map));
}

std::vector<TestView> SeeAlongPath(TestScene* scene, int count, double step) {
  std::vector<TestView> views;
  for (int i = 0; i < count; ++i) {
    const Eigen::Vector3d centre(step * i, 0.05 * std::sin(i), 0.1 * std::cos(2 * i) - 0.1);
    views.push_back(scene->See(CameraAt(centre, Eigen::Vector3d(0.01 * std::sin(i), 0.02 * std::sin(2 * i), 0))));
  }
  return views;
}

MapPointId TruePointId(int point) {
  return MapPointId(1, 1, static_cast<uint32_t>(point) + 1);
}

Map BuildTrueMap(const TestScene& scene, const std::vector<TestView>& views, int every) {
  Map map(MapId(1, 1, 1), 1);
  std::map<int, std::vector<Observation>> seen;
  KeyFrameId parent;
  for (const TestView& view : views) {
    map.AddKeyFrame(view.data, view.camera_from_map, parent);
    parent = view.data->id;
    for (uint32_t f = 0; f < view.points.size(); ++f) {
      if (view.points[f] >= 0 && view.points[f] % every == 0) seen[view.points[f]].push_back({view.data->id, f});
    }
  }
  for (const auto& [point, observations] : seen) {
    if (observations.size() < 2) continue;
    map.AddPoint(TruePointId(point), scene.points_in_map()[static_cast<size_t>(point)].cast<float>());
    for (const Observation& o : observations) map.AddObservation(TruePointId(point), o.keyframe, o.feature);
  }
  map.RefreshDerived();
  return map;
}

std::vector<std::pair<uint32_t, uint32_t>> TrueMatches(const TestView& first, const TestView& second) {
  std::map<int, uint32_t> feature_of_point;
  for (uint32_t f = 0; f < second.points.size(); ++f) feature_of_point[second.points[f]] = f;
  std::vector<std::pair<uint32_t, uint32_t>> matches;
  for (uint32_t f = 0; f < first.points.size(); ++f) {
    const auto found = feature_of_point.find(first.points[f]);
    if (first.points[f] >= 0 && found != feature_of_point.end()) matches.emplace_back(f, found->second);
  }
  return matches;
}

int TruePointOf(const MapPoint& point, const std::vector<TestView>& views) {
  for (const TestView& view : views) {
    const Observation* observation = point.FindObservation(view.data->id);
    if (observation != nullptr) return view.points[observation->feature];
  }
  return -1;
}

KeyFrameMessage TrackedMessage(const Map& map, const TestView& view, const std::vector<TestView>& earlier) {
  KeyFrameMessage message;
  message.kind = KeyFrameKind::kTracked;
  message.map = map.id();
  message.camera_from_map = view.camera_from_map;
  message.reference = map.keyframes().rbegin()->first;
  std::map<int, uint32_t> feature_of_point;
  for (uint32_t f = 0; f < view.points.size(); ++f) feature_of_point[view.points[f]] = f;
  for (const MapPointId id : map.SortedPointIds()) {
    const auto found = feature_of_point.find(TruePointOf(map.point(id), earlier));
    if (found != feature_of_point.end() && found->first >= 0) message.landmarks.emplace_back(found->second, id);
  }
  return message;
}

}  // namespace portolan
