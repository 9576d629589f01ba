// The tracker among several maps, on rendered images: new maps that overlap old ones, going over, fusion, commands.

#include "testing/matchers.h"
#include "tracking/tracker_test_film.h"

namespace portolan {
namespace {

using ::testing::IsEmpty;
using ::testing::SizeIs;

constexpr int kLastPlace = 32;
constexpr double kSecondScale = 2.5;  // units per metre of the second map

TrackerOptions SmallMaps() {
  TrackerOptions options = MakeOptions();
  options.max_map_keyframes = 5;
  return options;
}

std::vector<Request> RequestsOf(const std::vector<Request>& requests, const std::string& kind) {
  std::vector<Request> found;
  for (const Request& request : requests) {
    if (request.kind == kind) found.push_back(request);
  }
  return found;
}

class TrackerMapsTest : public TrackerTest {
 protected:
  /// Moves on from the first place until the camera is in a second map; no frame may be lost. @return the next place.
  int GoIntoSecondMap() {
    Restart(SmallMaps());
    int place = Initialize();
    first_map_ = tracker_->active_map();
    mapper_->next_scale = kSecondScale;
    for (; place < kLastPlace; ++place) {
      const Tracker::Output output = Show(place);
      ExpectRightPose(output, place);
      requests_.insert(requests_.end(), output.requests.begin(), output.requests.end());
      if (output.state.map != first_map_) {
        second_map_ = output.state.map;
        return place + 1;
      }
    }
    ADD_FAILURE() << "no second map";
    return place;
  }
  Sim3d TrueSecondFromFirst() const {
    return mapper_->MapFromWorld(second_map_) * mapper_->MapFromWorld(first_map_).Inverse();
  }
  Command MakeCommand(CommandKind kind, MapId map, MapId other, const Sim3d& map_from_other = Sim3d()) const {
    Command command;
    command.kind = kind;
    command.map = map;
    command.other = other;
    command.map_from_other = map_from_other;
    return command;
  }

  MapId first_map_, second_map_;
  std::vector<Request> requests_;
};

TEST_F(TrackerMapsTest, AFullMapEndsInANewOneWithoutALostFrame) {
  int place = GoIntoSecondMap();
  EXPECT_GE(tracker_->replicas().at(first_map_).map().keyframes().size(), 5u);
  const auto asked = RequestsOf(requests_, "new_map");
  ASSERT_THAT(asked, SizeIs(1)) << "the first map was asked for before";
  EXPECT_EQ(asked[0].map, second_map_);
  EXPECT_EQ(asked[0].other, first_map_);
  // The first two keyframes of the second map are frames of the first: that tells where the maps lie.
  const auto links = RequestsOf(requests_, "link_maps");
  ASSERT_THAT(links, SizeIs(1));
  EXPECT_EQ(links[0].map, second_map_);
  EXPECT_EQ(links[0].other, first_map_);
  const Sim3d truth = TrueSecondFromFirst();
  EXPECT_NEAR(links[0].map_from_other.scale / truth.scale, 1, 0.01);
  EXPECT_LT(links[0].map_from_other.rotation.angularDistance(truth.rotation), 5e-3);
  const Eigen::Vector3d camera = mapper_->TrueCameraFromMap(place - 1, first_map_).TargetOriginInSource();
  EXPECT_LT((links[0].map_from_other * camera - truth * camera).norm(), 0.03 * kSecondScale);
  EXPECT_EQ(tracker_->map_events().switches, 0u) << "the map is new, nobody was there before";
  EXPECT_THAT(tracker_->map_events().frames_to_new_map, IsEmpty()) << "the tracker was not lost";
  for (; place < kLastPlace; ++place) ExpectRightPose(Show(place), place);
}

TEST_F(TrackerMapsTest, FramesOfBothMapsAreInTheHistoryOnce) {
  GoIntoSecondMap();
  tracker_->FinishHistory();
  EXPECT_EQ(tracker_->history().records().size(), places_.size());
}

TEST_F(TrackerMapsTest, GoesIntoAMapWhenItIsTold) {
  int place = GoIntoSecondMap();
  tracker_->OnCommand(MakeCommand(CommandKind::kActivateMap, first_map_, second_map_, TrueSecondFromFirst().Inverse()));
  const Tracker::Output output = Show(place);
  EXPECT_EQ(output.state.map, first_map_);
  ExpectRightPose(output, place);
  const auto entered = RequestsOf(output.requests, "enter_map");
  ASSERT_THAT(entered, SizeIs(1));
  EXPECT_EQ(entered[0].map, first_map_);
  EXPECT_EQ(entered[0].other, second_map_);
  EXPECT_NEAR(entered[0].map_from_other.scale * kSecondScale, 1, 0.01);
  EXPECT_EQ(tracker_->map_events().switches, 1u);
  // The velocity came along: back the way it came, no frame is lost.
  for (int i = 1; i < 6; ++i) ExpectRightPose(Show(place - i), place - i);
  EXPECT_EQ(tracker_->active_map(), first_map_);
}

TEST_F(TrackerMapsTest, ACommandForAnotherMapOrRobotIsNotObeyed) {
  const int place = GoIntoSecondMap();
  tracker_->OnCommand(MakeCommand(CommandKind::kActivateMap, first_map_, MapId(0, 9, 9), Sim3d()));
  Command other_robot = MakeCommand(CommandKind::kActivateMap, first_map_, MapId());
  other_robot.robot = 3;
  tracker_->OnCommand(other_robot);
  EXPECT_EQ(Show(place).state.map, second_map_);
}

TEST_F(TrackerMapsTest, SaysSoWhenTheCameraIsNotInTheMap) {
  int place = GoIntoSecondMap();
  // A map of the same images whose points are nowhere.
  const MapId wrong(0, 8, 1);
  Map map(wrong, 1);
  tracker_->OnCommand(MakeCommand(CommandKind::kActivateMap, wrong, second_map_, Sim3d()));
  ASSERT_THAT(tracker_->ReplicasInNeed(), SizeIs(1));
  EXPECT_TRUE(tracker_->IsFresh(wrong));
  Random random(1);
  uint32_t number = 0;
  for (const auto& [id, keyframe] : mapper_->MapOf(first_map_).keyframes()) {
    map.AddKeyFrame(keyframe.data, keyframe.camera_from_map,
                    map.keyframes().empty() ? KeyFrameId() : map.keyframes().begin()->first);
  }
  for (const auto& [id, keyframe] : map.keyframes()) {
    if (id == map.keyframes().begin()->first) continue;
    for (uint32_t i = 0; i < 200; ++i) {
      const MapPointId point(0, 78, ++number);
      map.AddPoint(point,
                   Eigen::Vector3f(static_cast<float>(random.Uniform(-5, 5)), static_cast<float>(random.Uniform(-5, 5)),
                                   static_cast<float>(random.Uniform(2, 9))));
      map.AddObservation(point, map.keyframes().begin()->first, i);
      map.AddObservation(point, id, i);
    }
  }
  tracker_->AddDelta(map.TakeDelta());  // its keyframes are known from the first map
  std::vector<Request> refusals;
  int frames = 0;
  for (; frames < 40 && refusals.empty(); ++frames) {
    const Tracker::Output output = Show(place + frames % 2);
    EXPECT_EQ(output.state.map, second_map_);
    refusals = RequestsOf(output.requests, "refuse_map");
  }
  EXPECT_EQ(frames, 30);
  ASSERT_THAT(refusals, SizeIs(1));
  EXPECT_EQ(refusals[0].map, wrong);
  EXPECT_EQ(refusals[0].other, second_map_);
  EXPECT_FALSE(refusals[0].argument.empty());
}

TEST_F(TrackerMapsTest, GoesOnInTheMapThatTookItsOwnIn) {
  int place = GoIntoSecondMap();
  for (int i = 0; i < 2; ++i, ++place) ExpectRightPose(Show(place), place);
  tracker_->OnCommand(MakeCommand(CommandKind::kLocalizeOnly, MapId(), MapId()));  // this map is to stay the last
  const size_t records = tracker_->history().records().size();
  // The mapper moves everything of the second map into the first.
  const Sim3d first_from_second = TrueSecondFromFirst().Inverse();
  Map& first = mapper_->MapOf(first_map_);
  Map& second = mapper_->MapOf(second_map_);
  for (const auto& [id, keyframe] : second.keyframes()) {
    const KeyFrameId parent = keyframe.parent.IsValid() ? keyframe.parent : first.keyframes().begin()->first;
    first.AddKeyFrame(keyframe.data, TransformPose(keyframe.camera_from_map, first_from_second), parent);
  }
  for (const MapPointId id : second.SortedPointIds()) {
    first.AddPoint(id, (first_from_second * second.point(id).position_in_map.cast<double>()).cast<float>());
    for (const Observation& o : second.point(id).observations) first.AddObservation(id, o.keyframe, o.feature);
  }
  tracker_->OnCommand(MakeCommand(CommandKind::kFuseMaps, first_map_, second_map_, first_from_second));
  EXPECT_EQ(Show(place).state.map, second_map_) << "the first map's replica does not hold the keyframes yet";
  tracker_->AddDelta(first.TakeDelta());
  const Tracker::Output output = Show(place);
  EXPECT_EQ(output.state.map, first_map_);
  ExpectRightPose(output, place);
  EXPECT_EQ(tracker_->replicas().count(second_map_), 0u);
  EXPECT_EQ(tracker_->map_events().fusions, 1u);
  // Frames that hung on the second map's keyframes are the first's now, and where they were.
  EXPECT_EQ(tracker_->history().records().size(), records + 2);
  for (const auto& [number, record] : tracker_->history().records()) {
    ASSERT_EQ(record.map, first_map_);
    const auto pose = FrameHistory::CameraFromMap(tracker_->replicas().at(first_map_).map(), record);
    ASSERT_TRUE(pose) << "frame " << number;
    const Rigid3d truth = mapper_->TrueCameraFromMap(places_[number], first_map_);
    EXPECT_LT((pose->TargetOriginInSource() - truth.TargetOriginInSource()).norm(), 0.02) << "frame " << number;
  }
  ExpectRightPose(Show(place + 1), place + 1);
}

TEST_F(TrackerMapsTest, BeginsANewMapWhenItIsTold) {
  int place = Initialize();
  const MapId first = tracker_->active_map();
  for (; place < 8; ++place) Show(place);
  tracker_->OnCommand(MakeCommand(CommandKind::kNewMap, MapId(), MapId()));
  for (; place < 20 && tracker_->active_map() == first; ++place) ExpectRightPose(Show(place), place);
  const MapId second = tracker_->active_map();
  EXPECT_NE(second, first);
  // Once it has grown, the link is measured again.
  std::vector<Request> links;
  for (; place < kLastPlace; ++place) {
    const Tracker::Output output = Show(place);
    ExpectRightPose(output, place);
    for (const Request& request : RequestsOf(output.requests, "link_maps")) links.push_back(request);
  }
  ASSERT_GE(tracker_->replicas().at(second).map().keyframes().size(), 10u);
  ASSERT_FALSE(links.empty());
  const Sim3d truth = mapper_->MapFromWorld(second) * mapper_->MapFromWorld(first).Inverse();
  for (const Request& link : links) EXPECT_NEAR(link.map_from_other.scale / truth.scale, 1, 0.01);
}

TEST_F(TrackerMapsTest, LocalisationOnlyChangesNoMap) {
  int place = Initialize();
  const size_t sent = tracker_->num_keyframes_sent();
  tracker_->OnCommand(MakeCommand(CommandKind::kLocalizeOnly, MapId(), MapId()));
  for (; place < 16; ++place) ExpectRightPose(Show(place), place);
  for (int i = 0; i < 10; ++i) EXPECT_THAT(RequestsOf(ShowBlack().requests, "new_map"), IsEmpty());
  EXPECT_EQ(tracker_->num_keyframes_sent(), sent);
  EXPECT_EQ(Show(3).state.state, TrackingState::kTracking);
  // And goes on mapping when it is told.
  tracker_->OnCommand(MakeCommand(CommandKind::kMapAgain, MapId(), MapId()));
  for (place = 4; place < 20; ++place) Show(place);
  EXPECT_GT(tracker_->num_keyframes_sent(), sent);
}

TEST_F(TrackerMapsTest, LocalisationOnlyTellsNothingOfHowMapsLie) {
  int place = GoIntoSecondMap();
  tracker_->OnCommand(MakeCommand(CommandKind::kLocalizeOnly, MapId(), MapId()));
  tracker_->OnCommand(MakeCommand(CommandKind::kActivateMap, first_map_, second_map_, TrueSecondFromFirst().Inverse()));
  std::vector<Request> requests;
  for (int i = 0; i < 12; ++i) {
    const Tracker::Output output = Show(place - i);
    EXPECT_EQ(output.state.map, first_map_);
    requests.insert(requests.end(), output.requests.begin(), output.requests.end());
  }
  ASSERT_THAT(requests, SizeIs(1));
  EXPECT_EQ(requests[0].kind, "enter_map");
  EXPECT_EQ(requests[0].map, first_map_);
  EXPECT_FALSE(requests[0].other.IsValid());
}

TEST_F(TrackerMapsTest, AtTheStartTheAtlasIsAskedBeforeAMapBegins) {
  int place = Initialize();
  for (; place < 14; ++place) Show(place);
  tracker_->ApplyPending();
  const MapId kept = tracker_->active_map();
  const Map map = mapper_->map;
  places_.clear();
  StartTracker(MakeOptions(), 6);
  const auto asked = tracker_->RequestFirstMap();
  ASSERT_THAT(asked, SizeIs(1));
  Reply reply;
  reply.ok = true;
  reply.text = "1";
  tracker_->OnReply(asked[0], reply);
  std::vector<KeyFrameMessage> queries;
  for (int i = 0; i < 8; ++i) {
    const Tracker::Output output = Show(6 + i);
    EXPECT_EQ(output.state.state, TrackingState::kInitializing);
    for (const KeyFrameMessage& message : output.keyframes) queries.push_back(message);
    if (i == 0) {
      EXPECT_THAT(RequestsOf(output.requests, "locate"), SizeIs(1));
    }
  }
  ASSERT_THAT(queries, SizeIs(1)) << "one a second, and no pair of frames for a map";
  EXPECT_EQ(queries[0].kind, KeyFrameKind::kQuery);
  tracker_->OnCommand(MakeCommand(CommandKind::kActivateMap, kept, MapId()));
  ASSERT_THAT(tracker_->ReplicasInNeed(), SizeIs(1));
  EXPECT_TRUE(tracker_->IsFresh(kept));
  for (const auto& [id, keyframe] : map.keyframes()) {
    tracker_->AddKeyFrameData(kept, MakeKeyFrameData(*keyframe.data, vocabulary_->get()));
  }
  tracker_->AddDelta(map.Snapshot());
  const Tracker::Output output = Show(9);
  EXPECT_EQ(output.state.map, kept);
  ExpectRightPose(output, 9, 3);
  EXPECT_THAT(RequestsOf(output.requests, "enter_map"), SizeIs(1));
}

TEST_F(TrackerMapsTest, AResumedTrackerFindsItselfInTheMapOfTheOneBefore) {
  int place = Initialize();
  for (; place < 14; ++place) Show(place);
  tracker_->ApplyPending();
  const MapId kept = tracker_->active_map();
  const Map map = mapper_->map;
  const std::vector<FrameRecord> earlier = tracker_->TakeChangedFrames();
  ASSERT_GT(earlier.size(), 5u);
  StartTracker(MakeOptions(), 6);
  tracker_->Resume(earlier);
  ASSERT_THAT(tracker_->ReplicasInNeed(), SizeIs(1));
  EXPECT_TRUE(tracker_->IsFresh(kept));
  for (const auto& [id, keyframe] : map.keyframes()) {
    tracker_->AddKeyFrameData(kept, MakeKeyFrameData(*keyframe.data, vocabulary_->get()));
  }
  tracker_->AddDelta(map.Snapshot());
  const Tracker::Output output = Show(12);
  EXPECT_EQ(output.state.map, kept);
  ExpectRightPose(output, 12, 3);
  EXPECT_THAT(RequestsOf(output.requests, "enter_map"), SizeIs(1));
  EXPECT_EQ(tracker_->history().records().size(), earlier.size() + 1);
  ASSERT_THAT(tracker_->TakeChangedFrames(), SizeIs(1)) << "the earlier ones are known";
}

TEST_F(TrackerMapsTest, AMapperThatLostTheMapIsNotListenedTo) {
  Initialize();
  Command grant = MakeCommand(CommandKind::kGrantOwnership, tracker_->active_map(), MapId());
  grant.epoch = 3;
  grant.owner = ProcessId(0, 7, 1);
  tracker_->OnCommand(grant);
  MapperState state;
  state.process = ProcessId(0, 4, 1);
  state.map = tracker_->active_map();
  state.epoch = 2;
  EXPECT_FALSE(tracker_->OnMapperState(state));
  state.process = grant.owner;
  state.epoch = 3;
  EXPECT_TRUE(tracker_->OnMapperState(state));
}

TEST_F(TrackerMapsTest, AtTheStartAMapBeginsAfterThreeDenials) {
  const auto asked = tracker_->RequestFirstMap();
  Reply reply;
  reply.ok = true;
  reply.text = "4";
  tracker_->OnReply(asked[0], reply);
  Request locate;
  locate.kind = "locate";
  Show(0);
  for (int i = 0; i < 3; ++i) tracker_->OnReply(locate, Reply());
  Initialize();
  EXPECT_EQ(tracker_->state(), TrackingState::kTracking);
}

TEST_F(TrackerMapsTest, AForgottenMapIsLeft) {
  int place = Initialize();
  const MapId gone = tracker_->active_map();
  tracker_->OnCommand(MakeCommand(CommandKind::kForgetMap, gone, MapId()));
  EXPECT_EQ(tracker_->replicas().count(gone), 0u);
  const Tracker::Output output = Show(place);
  EXPECT_EQ(output.state.state, TrackingState::kInitializing);
  EXPECT_THAT(RequestsOf(output.requests, "new_map"), SizeIs(1));
  for (; place < 20 && tracker_->state() != TrackingState::kTracking; ++place) Show(place);
  ExpectRightPose(Show(place), place);
}

TEST_F(TrackerMapsTest, MappersOfOtherMapsDoNotConcernIt) {
  Initialize();
  MapperState state;
  state.process = ProcessId(4, 1, 1);
  state.map = MapId(4, 1, 1);
  EXPECT_FALSE(tracker_->OnMapperState(state));
  state.map = tracker_->active_map();
  EXPECT_TRUE(tracker_->OnMapperState(state));
  // The owner of its map says that it is idle while it is at another robot's.
  state.map = MapId(4, 1, 1);
  EXPECT_TRUE(tracker_->OnMapperState(state));
}

TEST_F(TrackerMapsTest, LostInAnUnknownPlaceItBeginsANewMapThere) {
  int place = Initialize();
  for (; place < 10; ++place) Show(place);
  const MapId first = tracker_->active_map();
  for (int i = 0; i < 7; ++i) ShowBlack();
  ASSERT_EQ(tracker_->state(), TrackingState::kLost);
  // The same film upside down: nothing that it knows.
  Tracker::Output output;
  int frames = 0;
  for (; frames < 15 && output.state.state != TrackingState::kTracking; ++frames) {
    cv::Mat turned;
    cv::flip(film_->Render(place + frames), turned, 0);
    mapper_->refuse_pairs = false;
    output = tracker_->Track({places_.size() + 100, Timestamp::FromSeconds(100 + 0.05 * frames), turned});
    places_.push_back(place + frames);
    for (const KeyFrameMessage& message : output.keyframes) {
      if (message.kind == KeyFrameKind::kInitialSecond) {
        EXPECT_NE(message.map, first);
        return;
      }
    }
  }
  FAIL() << "no pair for a new map";
}

}  // namespace
}  // namespace portolan
