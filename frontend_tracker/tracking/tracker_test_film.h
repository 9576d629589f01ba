#pragma once

// For tests of the tracker on rendered images: a film, a scripted mapper that answers with deltas made from the truth,
// and a fixture of both.

#include <gmock/gmock.h>

#include <algorithm>
#include <functional>
#include <map>
#include <memory>
#include <opencv2/imgproc.hpp>
#include <utility>
#include <vector>

#include "base/random.h"
#include "testing/camera_path.h"
#include "testing/renderer.h"
#include "testing/synthetic_world.h"
#include "tracking/tracker.h"
#include "vocabulary/vocabulary_training.h"

namespace portolan {

inline const PinholeCamera kPinhole{400, 400, 239.5, 179.5, 480, 360};
constexpr double kStepMetres = 0.1;  // sideways from frame to frame: 7 to 10 pixels, most of which ESM takes for a turn

/// Overlapping rectangles of all greys: corners everywhere, each place its own.
inline cv::Mat PaintRectangles(uint64_t seed) {
  Random random(seed);
  cv::Mat picture(512, 512, CV_8UC1, cv::Scalar(128));
  for (int i = 0; i < 1500; ++i) {
    const cv::Point corner(static_cast<int>(random.Below(512)), static_cast<int>(random.Below(512)));
    const cv::Size size(static_cast<int>(6 + random.Below(26)), static_cast<int>(6 + random.Below(26)));
    cv::rectangle(picture, cv::Rect(corner, size), cv::Scalar(static_cast<double>(random.Below(256))), cv::FILLED);
  }
  return picture;
}

/// Two walls at different distances and a box before them.
inline SyntheticWorld MakeWorld() {
  WorldBuilder builder;
  const int near_wall = builder.AddTexture(PaintRectangles(1)), far_wall = builder.AddTexture(PaintRectangles(2));
  const int box = builder.AddTexture(PaintRectangles(3));
  builder.AddWall({4, 5}, {4, 0.2}, -4, 4, {near_wall, 4.0});
  builder.AddWall({6, 0.2}, {6, -6}, -4, 4, {far_wall, 5.0});
  builder.AddBox({3.2, -0.6}, {0.5, 0.6, 1.2}, 0.3, -0.8, {box, 2.0}, {box, 2.0});
  return builder.Take();
}

/// Frames of a camera that moves to the right, and the truth about each.
class Film {
 public:
  Film() : world_(MakeWorld()), renderer_(world_, kPinhole) {}

  Rigid3d WorldFromCamera(int place) const {
    CameraStance stance;
    stance.position_in_world = {0, 0.9 - kStepMetres * place, 0};
    return portolan::WorldFromCamera(stance);
  }
  const cv::Mat& Render(int place) {
    cv::Mat& image = images_[place];
    if (image.empty()) renderer_.Render(WorldFromCamera(place)).convertTo(image, CV_8U);
    return image;
  }
  const SyntheticWorld& world() const { return world_; }

 private:
  SyntheticWorld world_;
  Renderer renderer_;
  std::map<int, cv::Mat> images_;
};

inline TrackerOptions MakeOptions() {
  TrackerOptions options;
  options.orb.num_features = 700;
  options.initializer.min_baseline_px = 8;  // the film is short: a map and keyframes soon
  options.keyframe.distance_factor = 0.7;
  return options;
}

inline std::shared_ptr<const Vocabulary> TrainOn(Film* film) {
  CameraModel camera;
  camera.pinhole = kPinhole;
  OrbExtractor extractor(MakeOptions().orb);
  std::vector<std::vector<Descriptor>> images;
  for (int place = 0; place < 24; place += 6)
    images.push_back(extractor.Extract(film->Render(place), camera).descriptors);
  VocabularyTrainingOptions training;
  training.branching = 6;
  training.depth = 3;
  return TrainVocabulary(images, training, nullptr).value();
}

/// A mapper that knows the truth: keyframes stand where they stood, points lie on the walls. A map's frame is its first
/// camera's, its scale is `next_scale` units per metre.
class ScriptedMapper {
 public:
  ScriptedMapper(Film* film, std::function<int(uint64_t)> place_of_frame)
      : film_(film), place_of_frame_(std::move(place_of_frame)) {}

  bool refuse_pairs = false;
  bool busy = false;
  double next_scale = 1;  // of the maps to come
  Map map;                // the last one begun; without keyframes until a pair came

  /// Answers the keyframes of a frame.
  void Answer(const Tracker::Output& output, Tracker* tracker) {
    for (const KeyFrameMessage& message : output.keyframes) {
      if (message.kind == KeyFrameKind::kQuery) continue;
      auto data = std::make_shared<const KeyFrameData>(message.data);
      MapperState state;
      state.map = message.map;
      if (message.kind == KeyFrameKind::kInitialFirst) {
        first_ = data;
        continue;
      }
      state.last_keyframe = data->id;
      if (message.kind == KeyFrameKind::kInitialSecond && refuse_pairs) {
        state.refused_keyframe = data->id;
      } else if (message.kind == KeyFrameKind::kInitialSecond) {
        Begin(message, data);
      } else {
        Extend(message, data);
      }
      state.idle = !busy;
      Map& changed = MapOf(message.map);
      if (!changed.keyframes().empty()) tracker->AddDelta(changed.TakeDelta());
      tracker->OnMapperState(state);
    }
  }

  Map& MapOf(MapId id) { return id == map.id() || finished_.count(id) == 0 ? map : finished_.at(id); }
  const Sim3d& MapFromWorld(MapId id) const { return map_from_world_.at(id); }
  Rigid3d TrueCameraFromMap(int place, MapId id) const {
    return TransformPose(film_->WorldFromCamera(place).Inverse(), map_from_world_.at(id));
  }
  Rigid3d TrueCameraFromMap(int place) const { return TrueCameraFromMap(place, map.id()); }

 private:
  void Begin(const KeyFrameMessage& message, const std::shared_ptr<const KeyFrameData>& second) {
    const Rigid3d world_from_first = film_->WorldFromCamera(place_of_frame_(first_->frame));
    const Sim3d map_from_world =
        Sim3d(next_scale, Eigen::Quaterniond::Identity(), {0, 0, 0}) * Sim3d(world_from_first.Inverse());
    if (!map.keyframes().empty()) finished_.insert_or_assign(map.id(), std::move(map));
    map_from_world_[message.map] = map_from_world;
    map = Map(message.map, 1);
    map.AddKeyFrame(first_, TrueCameraFromMap(place_of_frame_(first_->frame)), KeyFrameId());
    const Rigid3d second_from_map = TrueCameraFromMap(place_of_frame_(second->frame));
    map.AddKeyFrame(second, second_from_map, first_->id);
    for (const auto& [a, b] : message.initial_matches) {
      const Eigen::Vector3d ray = kPinhole.Unproject(first_->features.pixels_px[a].cast<double>());
      const auto hit = CastRay(film_->world(), world_from_first.translation, world_from_first.rotation * ray);
      if (!hit) continue;
      const Eigen::Vector3d point = map_from_world * hit->point_in_world;
      if ((kPinhole.Project(second_from_map * point) - second->features.pixels_px[b].cast<double>()).norm() > 3)
        continue;
      const MapPointId id(0, 77, ++num_points_);
      map.AddPoint(id, point.cast<float>());
      map.AddObservation(id, first_->id, a);
      map.AddObservation(id, second->id, b);
    }
  }

  void Extend(const KeyFrameMessage& message, const std::shared_ptr<const KeyFrameData>& data) {
    Map& extended = MapOf(message.map);
    extended.AddKeyFrame(data, TrueCameraFromMap(place_of_frame_(data->frame), message.map), message.reference);
    for (const auto& [feature, landmark] : message.landmarks) extended.AddObservation(landmark, data->id, feature);
  }

  Film* film_;
  std::function<int(uint64_t)> place_of_frame_;
  std::shared_ptr<const KeyFrameData> first_;
  std::map<MapId, Map> finished_;
  std::map<MapId, Sim3d> map_from_world_;
  uint32_t num_points_ = 0;
};

class TrackerTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    film_ = new Film();
    vocabulary_ = new std::shared_ptr<const Vocabulary>(TrainOn(film_));
  }
  static void TearDownTestSuite() {
    delete vocabulary_;
    delete film_;
  }
  TrackerTest() { Restart(); }

  void Restart(const TrackerOptions& options = MakeOptions()) {
    places_.clear();
    mapper_ = std::make_unique<ScriptedMapper>(film_, [this](uint64_t frame) { return places_.at(frame); });
    StartTracker(options, 5);
  }
  void StartTracker(const TrackerOptions& options, uint32_t session) {
    CameraModel camera;
    camera.pinhole = kPinhole;
    tracker_ = std::make_unique<Tracker>(options, camera, *vocabulary_, 0, session);
  }

  /// The next frame, seen from a place; the mapper answers at once.
  Tracker::Output Show(int place) { return Show(place, film_->Render(place)); }
  Tracker::Output ShowBlack() { return Show(0, cv::Mat(kPinhole.height, kPinhole.width, CV_8UC1, cv::Scalar(0))); }
  Tracker::Output Show(int place, const cv::Mat& grey) {
    const uint64_t frame = places_.size();
    places_.push_back(place);
    Tracker::Output output = tracker_->Track({frame, Timestamp::FromSeconds(static_cast<double>(frame) / 20), grey});
    mapper_->Answer(output, tracker_.get());
    return output;
  }
  /// Moves on until it tracks. @return the next place.
  int Initialize() {
    for (int place = 0; place < 15; ++place) {
      if (Show(place).state.state == TrackingState::kTracking) return place + 1;
    }
    ADD_FAILURE() << "no map was made";
    return 15;
  }
  /// Within what a pixel of error in one match is worth at f = 400 and 5 m: 2.5 mrad, 12 mm. @param slack a factor:
  /// just relocalised there are tens of matches, not hundreds.
  void ExpectRightPose(const Tracker::Output& output, int place, double slack = 1) {
    ASSERT_EQ(output.state.state, TrackingState::kTracking) << "place " << place;
    const Rigid3d truth = mapper_->TrueCameraFromMap(place, output.state.map);
    const double units_per_metre = mapper_->MapFromWorld(output.state.map).scale;
    const Rigid3d& estimate = output.state.camera_from_map;
    EXPECT_LT(estimate.rotation.angularDistance(truth.rotation), slack * 2.5e-3) << "place " << place;
    EXPECT_LT((estimate.TargetOriginInSource() - truth.TargetOriginInSource()).norm(), slack * 0.012 * units_per_metre)
        << "place " << place;
  }

  static inline Film* film_ = nullptr;
  static inline std::shared_ptr<const Vocabulary>* vocabulary_ = nullptr;
  std::vector<int> places_;  // by frame
  std::unique_ptr<ScriptedMapper> mapper_;
  std::unique_ptr<Tracker> tracker_;
};

}  // namespace portolan
