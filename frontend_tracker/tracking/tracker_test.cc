// The tracker's states on rendered images, within one map.

#include "tracking/tracker_test_film.h"

namespace portolan {
namespace {

using ::testing::AllOf;
using ::testing::Each;
using ::testing::Gt;
using ::testing::IsEmpty;
using ::testing::Lt;
using ::testing::Not;
using ::testing::SizeIs;

/// The maps that were asked for.
std::vector<MapId> NewMapsOf(const Tracker::Output& output) {
  std::vector<MapId> maps;
  for (const Request& request : output.requests) {
    if (request.kind == "new_map") maps.push_back(request.map);
  }
  return maps;
}

TEST_F(TrackerTest, InitialisesAndTracksAtTheRightPose) {
  const Tracker::Output first = Show(0);
  EXPECT_EQ(first.state.state, TrackingState::kInitializing);
  ASSERT_THAT(NewMapsOf(first), SizeIs(1));
  size_t pairs = 0, keyframes = 0;
  for (int place = 1; place < 24; ++place) {
    const Tracker::Output output = Show(place);
    for (const KeyFrameMessage& message : output.keyframes) {
      pairs += message.kind == KeyFrameKind::kInitialSecond ? 1 : 0;
      keyframes += message.kind == KeyFrameKind::kTracked ? 1 : 0;
      EXPECT_EQ(message.map, NewMapsOf(first)[0]);
      EXPECT_EQ(message.vocabulary_hash, (*vocabulary_)->hash());
    }
    EXPECT_THAT(NewMapsOf(output), IsEmpty());
    if (pairs == 0 || !output.keyframes.empty()) continue;
    ExpectRightPose(output, place);
    EXPECT_EQ(output.state.map, NewMapsOf(first)[0]);
    EXPECT_GT(output.state.quality, 0.7);
  }
  EXPECT_EQ(pairs, 1u);
  EXPECT_GT(keyframes, 0u);
  tracker_->ApplyPending();  // the answer to the last frame
  EXPECT_EQ(HashMap(tracker_->replicas().at(tracker_->active_map()).map()), HashMap(mapper_->map));
}

TEST_F(TrackerTest, EveryFrameSinceTheMapsFirstIsInTheHistory) {
  Initialize();
  tracker_->FinishHistory();
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

/// Of a map that gets no other keyframes.
TrackerOptions MakeGapOptions() {
  TrackerOptions options = MakeOptions();
  options.initializer.min_baseline_px = 24;  // several frames lie between the two
  options.keyframe.distance_factor = 100;
  options.keyframe.max_reference_overlap = options.keyframe.known_place_overlap = 0;
  options.keyframe.few_points = 0;  // no keyframes but those
  return options;
}

TEST_F(TrackerTest, FramesBetweenAMapsFirstTwoBecomeKeyFrames) {
  Restart(MakeGapOptions());
  std::vector<uint64_t> pair, between;
  for (int place = 0; place < 24; ++place) {
    for (const KeyFrameMessage& message : Show(place).keyframes) {
      (message.kind == KeyFrameKind::kTracked ? between : pair).push_back(message.data.frame);
    }
  }
  ASSERT_THAT(pair, SizeIs(2));
  ASSERT_THAT(between, Not(IsEmpty()));
  EXPECT_THAT(between, Each(AllOf(Gt(pair[0]), Lt(pair[1]))));
  tracker_->ApplyPending();
  const Map& map = tracker_->replicas().at(tracker_->active_map()).map();
  EXPECT_EQ(HashMap(map), HashMap(mapper_->map));
  for (const uint64_t frame : between) {
    const KeyFrameId anchor = tracker_->history().records().at(frame).anchor;
    EXPECT_EQ(map.keyframe(anchor).data->frame, frame) << "it hangs on itself";
  }
}

TEST_F(TrackerTest, FramesBetweenAMapsFirstTwoWaitForTheMapperAWhile) {
  Restart(MakeGapOptions());
  mapper_->busy = true;
  int place = 0;
  while (place < 24 && Show(place).state.state != TrackingState::kTracking) ++place;
  ASSERT_LT(place, 24) << "no map was made";
  EXPECT_FALSE(tracker_->history().Has(1));
  const size_t sent = tracker_->num_keyframes_sent();
  for (int i = 0; i < 100; ++i) Show(place);
  EXPECT_TRUE(tracker_->history().Has(1));
  EXPECT_EQ(tracker_->num_keyframes_sent(), sent);
}

TEST_F(TrackerTest, IsLostAfterMoreThanFiveFramesAndComesBackToItsMap) {
  int place = Initialize();
  for (; place < 14; ++place) Show(place);
  const MapId map = tracker_->active_map();
  for (int i = 0; i < 5; ++i) {
    const Tracker::Output output = ShowBlack();
    EXPECT_EQ(output.state.state, TrackingState::kRelocalizing);
    EXPECT_THAT(NewMapsOf(output), IsEmpty());
  }
  const Tracker::Output lost = ShowBlack();
  EXPECT_EQ(lost.state.state, TrackingState::kLost);
  ASSERT_THAT(NewMapsOf(lost), SizeIs(1));
  EXPECT_NE(NewMapsOf(lost)[0], map);
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
  EXPECT_THAT(tracker_->unacknowledged(), IsEmpty());
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
  EXPECT_THAT(tracker_->unacknowledged(), IsEmpty());
  // The mapper is busy: a due keyframe is not sent, the mapper is told to stop.
  bool interrupted = false;
  size_t sent = tracker_->num_keyframes_sent();
  for (int i = 0; i < 12; ++i) interrupted = Show(place + i).state.interrupt_mapper || interrupted;
  EXPECT_TRUE(interrupted);
  EXPECT_EQ(tracker_->num_keyframes_sent(), sent);
  // Idle again, the next one is sent. While no delta holds it, it is kept, and no other is sent.
  MapperState idle;
  idle.map = map;
  idle.idle = true;
  tracker_->OnMapperState(idle);
  const int next = place + 12;
  places_.push_back(next);
  const Tracker::Output output = tracker_->Track({places_.size() - 1, Timestamp::FromSeconds(10), film_->Render(next)});
  ASSERT_THAT(output.keyframes, SizeIs(1));
  ASSERT_THAT(tracker_->unacknowledged(), SizeIs(1));
  EXPECT_EQ(tracker_->AwaitedKeyFrame(), output.keyframes[0].data.id);
  tracker_->OnMapperState(idle);  // says nothing about it
  EXPECT_TRUE(tracker_->AwaitedKeyFrame().has_value());
  mapper_->Answer(output, tracker_.get());
  tracker_->ApplyPending();
  EXPECT_THAT(tracker_->unacknowledged(), IsEmpty());
  EXPECT_FALSE(tracker_->AwaitedKeyFrame().has_value());
}

TEST_F(TrackerTest, AMapperThatDoesNotAnswerIsNotWaitedForWhenItIsUrgent) {
  mapper_->busy = true;
  const int place = Initialize();
  const size_t sent = tracker_->num_keyframes_sent();
  for (int i = 0; i < 12; ++i) EXPECT_THAT(Show(place + i).keyframes, IsEmpty());
  tracker_->SetMapperSilent(true);
  EXPECT_THAT(Show(place + 12).keyframes, SizeIs(1));
  EXPECT_EQ(tracker_->num_keyframes_sent(), sent + 1);
}

TEST_F(TrackerTest, WhatANewOwnerHasNotGotIsSentAgain) {
  int place = Initialize();
  const Map behind = mapper_->map;
  std::optional<KeyFrameId> taken_in;
  for (; place < 40 && !taken_in; ++place) {
    const Tracker::Output output = Show(place);
    if (!output.keyframes.empty()) taken_in = output.keyframes.back().data.id;
  }
  tracker_->ApplyPending();
  ASSERT_TRUE(taken_in);
  ASSERT_THAT(tracker_->unacknowledged(), IsEmpty());
  ASSERT_NE(tracker_->replicas().at(behind.id()).map().FindKeyFrame(*taken_in), nullptr);
  MapDelta snapshot = behind.Snapshot();
  snapshot.epoch = behind.epoch() + 1;
  tracker_->AddDelta(snapshot);
  tracker_->ApplyPending();
  ASSERT_THAT(tracker_->unacknowledged(), SizeIs(1));
  EXPECT_EQ(tracker_->unacknowledged().begin()->first, *taken_in);
  EXPECT_EQ(tracker_->AwaitedKeyFrame(), taken_in);
}

TEST_F(TrackerTest, TakesInWhatTheCalibrationLeft) {
  Initialize();
  EXPECT_TRUE(tracker_->camera().IsIdeal());
  const RadialResidual lens{0.002, -0.001}, better{0.0021, -0.0011};
  PinholeCamera other = kPinhole;
  other.fx += 1;
  mapper_->map.SetResidual(other, lens);
  tracker_->AddDelta(mapper_->map.TakeDelta());
  tracker_->ApplyPending();
  EXPECT_TRUE(tracker_->camera().IsIdeal()) << "it is another camera's";
  for (const RadialResidual& known : {lens, better}) {  // a larger map tells it more exactly
    mapper_->map.SetResidual(kPinhole, known);
    tracker_->AddDelta(mapper_->map.TakeDelta());
    tracker_->ApplyPending();
    EXPECT_EQ(tracker_->camera().residual, known);
  }
}

TEST_F(TrackerTest, SeesNothingInTheDark) {
  for (int i = 0; i < 10; ++i) {
    const Tracker::Output output = ShowBlack();
    EXPECT_EQ(output.state.state, TrackingState::kInitializing);
    EXPECT_THAT(output.keyframes, IsEmpty());
    EXPECT_THAT(NewMapsOf(output), SizeIs(i == 0 ? 1 : 0));
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
