#include "tracking/joined_trajectory.h"

#include <gmock/gmock.h>

#include <cmath>

#include "testing/matchers.h"
#include "tracking/synthetic_frame.h"

namespace portolan {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;
using ::testing::SizeIs;

constexpr size_t kViews = 12;

/// A camera's way through a scene, half of it in one map, half of it in another that is turned and three times as
/// large.
class JoinedTrajectoryTest : public ::testing::Test {
 protected:
  JoinedTrajectoryTest() {
    SyntheticSceneOptions options;
    options.num_views = kViews;
    scene_ = MakeSyntheticScene(options);
    AddMap(first_, Sim3d(), 0, kViews / 2);
    AddMap(second_, second_from_first_, kViews / 2, kViews);
  }
  void AddMap(MapId id, const Sim3d& map_from_world, size_t from, size_t to) {
    MapBuilderOptions builder;
    builder.map = id;
    builder.map_from_world = map_from_world;
    Map map = BuildMap(scene_, builder);
    MapReplica& replica = replicas_.emplace(id, MapReplica(id)).first->second;
    for (const SyntheticView& view : scene_.views) replica.AddKeyFrameData(view.data);
    replica.AddDelta(map.TakeDelta());
    replica.ApplyPending();
    for (size_t view = from; view < to; ++view) {
      Frame frame = FrameOfView(scene_, view);
      frame.reference = frame.data->id;
      frame.camera_from_map = map.keyframe(frame.reference).camera_from_map;
      frame.camera_from_start = view < from + 1 ? turn_between_maps_ * last_ : last_;
      last_ = frame.camera_from_start;
      history_.Add(map, frame, true);
    }
  }
  void ExpectTheWay(const Trajectory& trajectory, double tolerance) const {
    ASSERT_THAT(trajectory, SizeIs(kViews));
    for (size_t view = 0; view < kViews; ++view) {
      const Rigid3d truth = scene_.views[view].camera_from_world.Inverse();
      EXPECT_THAT(trajectory[view].world_from_camera, RigidNear(truth, (PoseTolerance{tolerance, tolerance})))
          << "view " << view;
    }
  }

  const MapId first_{0, 1, 1}, second_{0, 1, 2}, third_{0, 1, 3};
  const Sim3d second_from_first_{3, ExpSO3({0.2, 0.4, -0.3}), {5, 1, 2}};
  const Eigen::Quaterniond turn_between_maps_{ExpSO3({0, 1.5, 0})};
  Eigen::Quaterniond last_ = turn_between_maps_.conjugate();
  SyntheticScene scene_;
  std::map<MapId, MapReplica> replicas_;
  FrameHistory history_;
  LinkGraph links_{[this](MapId id) { return replicas_.count(id) == 1 ? &replicas_.at(id).map() : nullptr; }};
};

TEST_F(JoinedTrajectoryTest, GoesThroughTheLink) {
  links_.Link({second_, {}}, {first_, {}}, second_from_first_);
  const RunTrajectories run = MakeTrajectories(history_, replicas_, links_);
  ExpectTheWay(run.joined, 1e-4);
  EXPECT_THAT(run.unlinked_maps, IsEmpty());
  EXPECT_EQ(run.map_numbers.at(first_), 0);
  EXPECT_EQ(run.map_numbers.at(second_), 1);
  EXPECT_THAT(run.per_map, SizeIs(kViews));
  EXPECT_EQ(run.per_map.back().map, 1);
}

TEST_F(JoinedTrajectoryTest, GoesThroughAMapInWhichTheCameraNeverWas) {
  const Sim3d third_from_first(0.4, ExpSO3({0, 0, 1}), {7, 7, 7});
  links_.Link({third_, {}}, {first_, {}}, third_from_first);
  links_.Link({second_, {}}, {third_, {}}, second_from_first_ * third_from_first.Inverse());
  ExpectTheWay(MakeTrajectories(history_, replicas_, links_).joined, 1e-4);
}

TEST_F(JoinedTrajectoryTest, WithoutALinkTheCameraGoesOnAsFastAsBefore) {
  const RunTrajectories run = MakeTrajectories(history_, replicas_, links_);
  EXPECT_THAT(run.unlinked_maps, ElementsAre(second_));
  ASSERT_THAT(run.joined, SizeIs(kViews));
  const auto step = [&](size_t i) {
    return (run.joined[i].world_from_camera.translation - run.joined[i - 1].world_from_camera.translation).norm();
  };
  EXPECT_NEAR(step(kViews - 1) / step(1), 1, 0.05);
  // The ways before and after are 1.5 rad apart by dead reckoning: their mean is shorter than each.
  EXPECT_NEAR(step(kViews / 2) / step(1), std::cos(1.5 / 2), 0.1) << "went on meanwhile";
  const Eigen::Quaterniond turn = run.joined[kViews / 2].world_from_camera.rotation.conjugate() *
                                  run.joined[kViews / 2 - 1].world_from_camera.rotation;
  EXPECT_NEAR(turn.angularDistance(turn_between_maps_), 0, 1e-6) << "turned as dead reckoning says";
}

}  // namespace
}  // namespace portolan
