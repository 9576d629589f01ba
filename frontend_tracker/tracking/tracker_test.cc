// The tracker's states on rendered images, with a scripted mapper that answers with deltas made from the truth.

#include "tracking/tracker.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <functional>
#include <map>
#include <memory>
#include <opencv2/imgproc.hpp>

#include "base/random.h"
#include "testing/camera_path.h"
#include "testing/renderer.h"
#include "testing/synthetic_world.h"
#include "vocabulary/vocabulary_training.h"

namespace portolan {
namespace {

using ::testing::IsEmpty;
using ::testing::SizeIs;

const PinholeCamera kPinhole{400, 400, 239.5, 179.5, 480, 360};
constexpr double kStepMetres = 0.1;  // sideways from frame to frame: 7 to 10 pixels, most of which ESM takes for a turn

/// Overlapping rectangles of all greys: corners everywhere, each place its own.
cv::Mat PaintRectangles(uint64_t seed) {
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
SyntheticWorld MakeWorld() {
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

TrackerOptions MakeOptions() {
  TrackerOptions options;
  options.orb.num_features = 700;
  options.initializer.min_baseline_px = 8;  // the film is short: a map and keyframes soon
  options.keyframe.distance_factor = 0.7;
  return options;
}

std::shared_ptr<const Vocabulary> TrainOn(Film* film) {
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

/// A mapper that knows the truth: keyframes stand where they stood, points lie on the walls. The map's frame is its
/// first camera's.
class ScriptedMapper {
 public:
  ScriptedMapper(Film* film, std::function<int(uint64_t)> place_of_frame)
      : film_(film), place_of_frame_(std::move(place_of_frame)) {}

  bool refuse_pairs = false;
  bool busy = false;
  Map map;  // without keyframes until a pair came

  /// Answers the keyframes of a frame.
  void Answer(const Tracker::Output& output, Tracker* tracker) {
    for (const KeyFrameMessage& message : output.keyframes) {
      auto data = std::make_shared<const KeyFrameData>(message.data);
      MapperState state;
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
      if (!map.keyframes().empty()) tracker->AddDelta(map.TakeDelta());
      tracker->OnMapperState(state);
    }
  }

  Rigid3d TrueCameraFromMap(int place) const { return film_->WorldFromCamera(place).Inverse() * world_from_map_; }

 private:
  void Begin(const KeyFrameMessage& message, const std::shared_ptr<const KeyFrameData>& second) {
    world_from_map_ = film_->WorldFromCamera(place_of_frame_(first_->frame));
    map = Map(message.map, 1);
    map.AddKeyFrame(first_, Rigid3d(), KeyFrameId());
    const Rigid3d second_from_map = TrueCameraFromMap(place_of_frame_(second->frame));
    map.AddKeyFrame(second, second_from_map, first_->id);
    uint32_t number = 0;
    for (const auto& [a, b] : message.initial_matches) {
      const Eigen::Vector3d ray = kPinhole.Unproject(first_->features.pixels_px[a].cast<double>());
      const auto hit = CastRay(film_->world(), world_from_map_.translation, world_from_map_.rotation * ray);
      if (!hit) continue;
      const Eigen::Vector3d point = world_from_map_.Inverse() * hit->point_in_world;
      if ((kPinhole.Project(second_from_map * point) - second->features.pixels_px[b].cast<double>()).norm() > 3)
        continue;
      const MapPointId id(0, 77, ++number);
      map.AddPoint(id, point.cast<float>());
      map.AddObservation(id, first_->id, a);
      map.AddObservation(id, second->id, b);
    }
  }

  void Extend(const KeyFrameMessage& message, const std::shared_ptr<const KeyFrameData>& data) {
    map.AddKeyFrame(data, TrueCameraFromMap(place_of_frame_(data->frame)), message.reference);
    for (const auto& [feature, landmark] : message.landmarks) map.AddObservation(landmark, data->id, feature);
  }

  Film* film_;
  std::function<int(uint64_t)> place_of_frame_;
  std::shared_ptr<const KeyFrameData> first_;
  Rigid3d world_from_map_;
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

  void Restart() {
    CameraModel camera;
    camera.pinhole = kPinhole;
    places_.clear();
    mapper_ = std::make_unique<ScriptedMapper>(film_, [this](uint64_t frame) { return places_.at(frame); });
    tracker_ = std::make_unique<Tracker>(MakeOptions(), camera, *vocabulary_, 0, 5);
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
    const Rigid3d truth = mapper_->TrueCameraFromMap(place);
    const Rigid3d& estimate = output.state.camera_from_map;
    EXPECT_LT(estimate.rotation.angularDistance(truth.rotation), slack * 2.5e-3) << "place " << place;
    EXPECT_LT((estimate.TargetOriginInSource() - truth.TargetOriginInSource()).norm(), slack * 0.012)
        << "place " << place;
  }

  static Film* film_;
  static std::shared_ptr<const Vocabulary>* vocabulary_;
  std::vector<int> places_;  // by frame
  std::unique_ptr<ScriptedMapper> mapper_;
  std::unique_ptr<Tracker> tracker_;
};
Film* TrackerTest::film_ = nullptr;
std::shared_ptr<const Vocabulary>* TrackerTest::vocabulary_ = nullptr;

TEST_F(TrackerTest, InitialisesAndTracksAtTheRightPose) {
  const Tracker::Output first = Show(0);
  EXPECT_EQ(first.state.state, TrackingState::kInitializing);
  ASSERT_THAT(first.new_maps, SizeIs(1));
  size_t pairs = 0, keyframes = 0;
  for (int place = 1; place < 24; ++place) {
    const Tracker::Output output = Show(place);
    for (const KeyFrameMessage& message : output.keyframes) {
      pairs += message.kind == KeyFrameKind::kInitialSecond ? 1 : 0;
      keyframes += message.kind == KeyFrameKind::kTracked ? 1 : 0;
      EXPECT_EQ(message.map, first.new_maps[0]);
      EXPECT_EQ(message.vocabulary_hash, (*vocabulary_)->hash());
    }
    EXPECT_THAT(output.new_maps, IsEmpty());
    if (pairs == 0 || !output.keyframes.empty()) continue;
    ExpectRightPose(output, place);
    EXPECT_EQ(output.state.map, first.new_maps[0]);
    EXPECT_GT(output.state.quality, 0.7);
  }
  EXPECT_EQ(pairs, 1u);
  EXPECT_GT(keyframes, 0u);
  tracker_->ApplyPending();  // the answer to the last frame
  EXPECT_EQ(HashMap(tracker_->replicas().at(tracker_->active_map()).map()), HashMap(mapper_->map));
}

TEST_F(TrackerTest, EveryFrameSinceTheMapsFirstIsInTheHistory) {
  Initialize();
  tracker_->FinishBackfill();
  const Map& map = tracker_->replicas().at(tracker_->active_map()).map();
  const auto& records = tracker_->history().records();
  ASSERT_THAT(records, SizeIs(places_.size()));
  for (const auto& [number, record] : records) {
    const auto pose = FrameHistory::CameraFromMap(map, record);
    ASSERT_TRUE(pose.has_value());
    const Rigid3d truth = mapper_->TrueCameraFromMap(places_[number]);
    EXPECT_LT((pose->TargetOriginInSource() - truth.TargetOriginInSource()).norm(), 0.02) << "frame " << number;
  }
  EXPECT_FALSE(records.at(1).online);  // between the two: known only afterwards
}

TEST_F(TrackerTest, IsLostAfterMoreThanFiveFramesAndComesBackToItsMap) {
  int place = Initialize();
  for (; place < 14; ++place) Show(place);
  const MapId map = tracker_->active_map();
  for (int i = 0; i < 5; ++i) {
    const Tracker::Output output = ShowBlack();
    EXPECT_EQ(output.state.state, TrackingState::kRelocalizing);
    EXPECT_THAT(output.new_maps, IsEmpty());
  }
  const Tracker::Output lost = ShowBlack();
  EXPECT_EQ(lost.state.state, TrackingState::kLost);
  ASSERT_THAT(lost.new_maps, SizeIs(1));
  EXPECT_NE(lost.new_maps[0], map);
  EXPECT_FALSE(lost.state.map.IsValid());
  EXPECT_EQ(ShowBlack().state.state, TrackingState::kLost);
  // Back where it was, seen before: the old map goes on.
  const Tracker::Output found = Show(9);
  EXPECT_EQ(found.state.map, map);
  ExpectRightPose(found, 9, 3);
  ExpectRightPose(Show(10), 10);
}

TEST_F(TrackerTest, AShortBlackoutEndsInRelocalisation) {
  int place = Initialize();
  for (; place < 14; ++place) Show(place);
  for (int i = 0; i < 3; ++i) ShowBlack();
  const Tracker::Output found = Show(8);
  ExpectRightPose(found, 8, 3);
  Show(9);
  ExpectRightPose(Show(10), 10);
  EXPECT_EQ(tracker_->replicas().size(), 1u);
}

TEST_F(TrackerTest, ARefusedPairIsForgottenAndAnotherOffered) {
  mapper_->refuse_pairs = true;
  std::vector<KeyFrameId> refused;
  int place = 0;
  for (; place < 12 && refused.empty(); ++place) {
    for (const KeyFrameMessage& message : Show(place).keyframes) refused.push_back(message.data.id);
  }
  ASSERT_THAT(refused, SizeIs(2));
  EXPECT_THAT(tracker_->UnacknowledgedKeyFrames(), IsEmpty());
  EXPECT_FALSE(tracker_->AwaitedKeyFrame().has_value());
  EXPECT_EQ(tracker_->state(), TrackingState::kInitializing);
  mapper_->refuse_pairs = false;
  Tracker::Output output;
  for (int i = 0; i < 3 && tracker_->state() != TrackingState::kTracking; ++i) output = Show(place++);
  ExpectRightPose(output, place - 1);
}

TEST_F(TrackerTest, KeyFramesAreKeptUntilADeltaHoldsThem) {
  Show(0);
  const MapId map = tracker_->replicas().begin()->first;
  mapper_->busy = true;
  const int place = Initialize();
  EXPECT_EQ(tracker_->active_map(), map);
  EXPECT_THAT(tracker_->UnacknowledgedKeyFrames(), IsEmpty());
  // The mapper is busy: a due keyframe is not sent, the mapper is told to stop.
  bool interrupted = false;
  size_t sent = tracker_->num_keyframes_sent();
  for (int i = 0; i < 12; ++i) interrupted = Show(place + i).state.interrupt_mapper || interrupted;
  EXPECT_TRUE(interrupted);
  EXPECT_EQ(tracker_->num_keyframes_sent(), sent);
  // Idle again, the next one is sent. While no delta holds it, it is kept, and no other is sent.
  MapperState idle;
  idle.idle = true;
  tracker_->OnMapperState(idle);
  const int next = place + 12;
  places_.push_back(next);
  const Tracker::Output output = tracker_->Track({places_.size() - 1, Timestamp::FromSeconds(10), film_->Render(next)});
  ASSERT_THAT(output.keyframes, SizeIs(1));
  ASSERT_THAT(tracker_->UnacknowledgedKeyFrames(), SizeIs(1));
  EXPECT_EQ(tracker_->num_unacknowledged(), 1u);
  EXPECT_EQ(tracker_->AwaitedKeyFrame(), output.keyframes[0].data.id);
  tracker_->OnMapperState(idle);  // says nothing about it
  EXPECT_TRUE(tracker_->AwaitedKeyFrame().has_value());
  mapper_->Answer(output, tracker_.get());
  tracker_->ApplyPending();
  EXPECT_THAT(tracker_->UnacknowledgedKeyFrames(), IsEmpty());
  EXPECT_EQ(tracker_->num_unacknowledged(), 0u);
  EXPECT_FALSE(tracker_->AwaitedKeyFrame().has_value());
}

TEST_F(TrackerTest, TakesInWhatTheCalibrationLeft) {
  EXPECT_TRUE(tracker_->camera().IsIdeal());
  MapperState state;
  tracker_->OnMapperState(state);
  EXPECT_TRUE(tracker_->camera().IsIdeal());
  state.residual = {0.02, -0.01};
  tracker_->OnMapperState(state);
  EXPECT_EQ(tracker_->camera().residual, state.residual);
  MapperState later = state;
  later.residual = {};
  tracker_->OnMapperState(later);
  EXPECT_EQ(tracker_->camera().residual, state.residual);
  later.residual = {0.021, -0.011};
  tracker_->OnMapperState(later);
  EXPECT_EQ(tracker_->camera().residual, later.residual) << "a larger map tells it more exactly";
}

TEST_F(TrackerTest, SeesNothingInTheDark) {
  for (int i = 0; i < 10; ++i) {
    const Tracker::Output output = ShowBlack();
    EXPECT_EQ(output.state.state, TrackingState::kInitializing);
    EXPECT_THAT(output.keyframes, IsEmpty());
    EXPECT_THAT(output.new_maps, SizeIs(i == 0 ? 1 : 0));
  }
}

TEST_F(TrackerTest, SameImagesGiveTheSameTrajectory) {
  const auto run = [this] {
    Restart();
    std::vector<Eigen::Vector3d> centres;
    for (int place = 0; place < 14; ++place) centres.push_back(Show(place).state.camera_from_map.translation);
    return centres;
  };
  EXPECT_EQ(run(), run());
}

/// A late answer to a pair that was refused: its keyframes are known, but are not the pair that waits.
TEST_F(TrackerTest, AMapWithoutThePairIsNotTakenForIt) {
  mapper_->refuse_pairs = true;
  Map late;
  for (int place = 0; place < 12; ++place) {
    const Tracker::Output output = Show(place);
    if (output.keyframes.size() != 2) continue;
    if (late.keyframes().empty()) {
      late = Map(output.keyframes[0].map, 1);
      for (const KeyFrameMessage& message : output.keyframes) {
        late.AddKeyFrame(std::make_shared<const KeyFrameData>(message.data), Rigid3d(), message.reference);
      }
      continue;
    }
    // The second pair's answer: the first pair's map.
    tracker_->AddDelta(late.TakeDelta());
    EXPECT_NO_THROW(Show(place + 1));
    EXPECT_EQ(tracker_->state(), TrackingState::kInitializing);
    EXPECT_EQ(tracker_->replicas().begin()->second.map().keyframes().size(), 2u);
    return;
  }
  FAIL() << "no second pair";
}

}  // namespace
}  // namespace portolan
