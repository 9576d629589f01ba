#include "tracking/frame_history.h"

#include <gtest/gtest.h>

#include "testing/matchers.h"
#include "tracking/synthetic_frame.h"

namespace portolan {
namespace {

class FrameHistoryTest : public ::testing::Test {
 protected:
  FrameHistoryTest() {
    SyntheticSceneOptions options;
    options.num_views = 6;
    options.travel = 1;
    scene_ = MakeSyntheticScene(options);
    MapBuilderOptions builder;
    builder.num_keyframes = 5;
    map_ = BuildMap(scene_, builder);
    static_cast<void>(map_.TakeDelta());
  }
  KeyFrameId Id(size_t view) const { return scene_.views[view].data->id; }
  Frame MakeFrame(uint64_t number, size_t reference) const {
    Frame frame;
    frame.number = number;
    frame.stamp = Timestamp::FromSeconds(static_cast<double>(number));
    frame.camera_from_map =
        Rigid3d(ExpSO3({0.01, 0.02, 0}), {0.1, 0.2, 0.3}) * map_.keyframe(Id(reference)).camera_from_map;
    frame.reference = Id(reference);
    return frame;
  }
  Rigid3d PoseNow(uint64_t number) const {
    const auto pose = FrameHistory::CameraFromMap(map_, history_.records().at(number));
    EXPECT_TRUE(pose.has_value()) << "frame " << number;
    return pose.value_or(Rigid3d());
  }
  void Publish() { history_.OnDelta(map_, map_.TakeDelta()); }

  SyntheticScene scene_;
  Map map_;
  FrameHistory history_;
};

TEST_F(FrameHistoryTest, FramesMoveWithTheKeyFrameTheyHangOn) {
  const Frame frame = MakeFrame(7, 2);
  history_.Add(map_, frame, true);
  EXPECT_THAT(PoseNow(7), RigidNear(frame.camera_from_map, PoseTolerance()));
  const Rigid3d correction(ExpSO3({0, 0.3, 0}), {1, 0, 0});
  map_.SetPose(Id(2), map_.keyframe(Id(2)).camera_from_map * correction);
  Publish();
  EXPECT_THAT(PoseNow(7), RigidNear(frame.camera_from_map * correction, PoseTolerance()));
  EXPECT_THAT(history_.records().at(7).online_camera_from_map, RigidNear(frame.camera_from_map, PoseTolerance()));
}

TEST_F(FrameHistoryTest, FramesOfRemovedKeyFramesPassToWhatTheseHungOn) {
  const Frame a = MakeFrame(7, 4), b = MakeFrame(8, 3), c = MakeFrame(9, 2);
  for (const Frame& frame : {a, b, c}) history_.Add(map_, frame, true);
  // The chain 4 -> 3 -> 2 -> 1 goes, link after link, within one delta and then in another.
  map_.RemoveKeyFrame(Id(4));
  map_.RemoveKeyFrame(Id(3));
  Publish();
  EXPECT_EQ(history_.records().at(7).anchor, Id(2));
  map_.RemoveKeyFrame(Id(2));
  Publish();
  for (const Frame& frame : {a, b, c}) {
    EXPECT_EQ(history_.records().at(frame.number).anchor, Id(1));
    EXPECT_THAT(PoseNow(frame.number), RigidNear(frame.camera_from_map, PoseTolerance()));
  }
}

TEST_F(FrameHistoryTest, AKeyFramesOwnFrameIsTheKeyFrame) {
  Frame frame = MakeFrame(7, 4);
  history_.Add(map_, frame, true);
  history_.NoteKeyFrame(7, Id(5));
  // The mapper takes it in at a somewhat better pose.
  const Rigid3d better = Rigid3d(ExpSO3({0.001, 0, 0}), {0.01, 0, 0}) * frame.camera_from_map;
  map_.AddKeyFrame(scene_.views[5].data, better, Id(4));
  Publish();
  EXPECT_EQ(history_.records().at(7).anchor, Id(5));
  EXPECT_THAT(PoseNow(7), RigidNear(better, PoseTolerance()));
  // And when it is pruned later, its frame stays where it was.
  map_.RemoveKeyFrame(Id(5));
  Publish();
  EXPECT_EQ(history_.records().at(7).anchor, Id(4));
  EXPECT_THAT(PoseNow(7), RigidNear(better, PoseTolerance()));
}

TEST_F(FrameHistoryTest, AKeyFrameOfAnUnrecordedFrameMakesNoRecord) {
  history_.NoteKeyFrame(70, Id(5));
  map_.AddKeyFrame(scene_.views[5].data, Rigid3d(), Id(4));
  Publish();
  EXPECT_TRUE(history_.records().empty());
}

TEST_F(FrameHistoryTest, AFrameWithoutAnchorIsNotRecorded) {
  Frame frame = MakeFrame(7, 4);
  frame.reference = KeyFrameId();
  history_.Add(map_, frame, true);
  EXPECT_TRUE(history_.records().empty());
}

TEST_F(FrameHistoryTest, APoseIsUnknownWithoutItsAnchor) {
  history_.Add(map_, MakeFrame(7, 2), false);
  EXPECT_FALSE(history_.records().at(7).online);
  EXPECT_FALSE(FrameHistory::CameraFromMap(Map(map_.id(), 1), history_.records().at(7)).has_value());
}

TEST_F(FrameHistoryTest, FramesPassToTheMapThatTookTheirsIn) {
  const Frame frame = MakeFrame(7, 2);
  history_.Add(map_, frame, true);
  // The same keyframes in another map: turned, shifted, and twice as long.
  const Sim3d map_from_other(2, ExpSO3({0.1, 0.5, -0.2}), {3, 1, 2});
  MapBuilderOptions builder;
  builder.map = MapId(0, 1, 9);
  builder.num_keyframes = 5;
  builder.map_from_world = map_from_other;
  Map fused = BuildMap(scene_, builder);
  history_.Fuse(fused.id(), map_.id(), map_from_other);
  const FrameRecord& record = history_.records().at(7);
  EXPECT_EQ(record.map, fused.id());
  const Rigid3d expected = TransformPose(frame.camera_from_map, map_from_other);
  const PoseTolerance tolerance{1e-6, 1e-5};
  EXPECT_THAT(FrameHistory::CameraFromMap(fused, record).value(), RigidNear(expected, tolerance));
  EXPECT_THAT(record.online_camera_from_map, RigidNear(expected, tolerance));
}

TEST_F(FrameHistoryTest, AKeyFrameRemovedAheadOfTheFusionLosesNoFrame) {
  const Frame frame = MakeFrame(7, 3);
  history_.Add(map_, frame, true);
  const Sim3d map_from_other(0.5, ExpSO3({0, 0.5, 0}), {0, 1, 0});
  MapBuilderOptions builder;
  builder.map = MapId(0, 1, 9);
  builder.num_keyframes = 5;
  builder.map_from_world = map_from_other;
  Map fused = BuildMap(scene_, builder);
  fused.RemoveKeyFrame(Id(3));
  history_.OnDelta(fused, fused.TakeDelta());
  EXPECT_EQ(history_.records().at(7).anchor, Id(3)) << "in its own map it is still there";
  history_.Fuse(fused.id(), map_.id(), map_from_other);
  EXPECT_EQ(history_.records().at(7).anchor, Id(2));
  const auto pose = FrameHistory::CameraFromMap(fused, history_.records().at(7));
  ASSERT_TRUE(pose);
  EXPECT_THAT(*pose, RigidNear(TransformPose(frame.camera_from_map, map_from_other), (PoseTolerance{1e-6, 1e-5})));
}

TEST_F(FrameHistoryTest, TellsWhatChanged) {
  for (const auto& [number, reference] : {std::pair<uint64_t, size_t>{7, 4}, {8, 3}})
    history_.Add(map_, MakeFrame(number, reference), true);
  EXPECT_EQ(history_.TakeChanged().size(), 2u);
  EXPECT_TRUE(history_.TakeChanged().empty());
  map_.RemoveKeyFrame(Id(4));
  Publish();
  const std::vector<FrameRecord> changed = history_.TakeChanged();
  ASSERT_EQ(changed.size(), 1u);
  EXPECT_EQ(changed[0].frame, 7u);
  EXPECT_EQ(changed[0].anchor, Id(3));
}

TEST_F(FrameHistoryTest, AnotherTrackerGoesOnWithTheFrames) {
  const Frame a = MakeFrame(7, 4), b = MakeFrame(8, 3);
  for (const Frame& frame : {a, b}) history_.Add(map_, frame, true);
  FrameHistory other;
  other.Restore(history_.TakeChanged());
  EXPECT_TRUE(other.TakeChanged().empty());
  map_.RemoveKeyFrame(Id(4));
  other.OnDelta(map_, map_.TakeDelta());
  EXPECT_EQ(other.records().at(7).anchor, Id(3));
  EXPECT_THAT(FrameHistory::CameraFromMap(map_, other.records().at(7)).value(),
              RigidNear(a.camera_from_map, PoseTolerance()));
}

TEST_F(FrameHistoryTest, FramesThatLostTheirKeyFrameUnheardHangWhereTheNearestDoes) {
  const Frame before = MakeFrame(5, 1), a = MakeFrame(7, 3), b = MakeFrame(8, 4), after = MakeFrame(9, 2);
  for (const Frame& frame : {before, a, b, after}) history_.Add(map_, frame, true);
  map_.RemoveKeyFrame(Id(4));
  map_.RemoveKeyFrame(Id(3));
  static_cast<void>(map_.TakeDelta());  // nobody listens
  history_.HangLooseFrames(map_);
  EXPECT_EQ(history_.records().at(8).anchor, Id(2));
  EXPECT_EQ(history_.records().at(7).anchor, Id(1)) << "as near to both: the one before";
  for (const Frame& frame : {before, a, b, after})
    EXPECT_THAT(PoseNow(frame.number), RigidNear(frame.camera_from_map, PoseTolerance()));
}

TEST_F(FrameHistoryTest, WithoutAnyKeyFrameLooseFramesStayLoose) {
  history_.Add(map_, MakeFrame(7, 3), true);
  const Map empty(map_.id(), 1);
  history_.HangLooseFrames(empty);
  EXPECT_FALSE(FrameHistory::CameraFromMap(empty, history_.records().at(7)).has_value());
}

}  // namespace
}  // namespace portolan
