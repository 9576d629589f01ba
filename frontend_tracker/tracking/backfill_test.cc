#include "tracking/backfill.h"

#include <gtest/gtest.h>

#include "tracking/synthetic_frame.h"

namespace portolan {
namespace {

constexpr size_t kNumKeyFrames = 3, kNumViews = 9;

/// A map of the first views of a sideways motion; the others are what was between.
struct Setting {
  SyntheticScene scene;
  Map map{MapId(0, 1, 1)};
  Backfill backfill{TrackerOptions(), SyntheticSceneOptions().camera};
  std::vector<Frame> between;

  Setting() {
    SyntheticSceneOptions options;
    options.num_views = kNumViews;
    options.num_landmarks = 600;
    options.travel = 0.6;
    scene = MakeSyntheticScene(options);
    MapBuilderOptions builder;
    builder.num_keyframes = kNumKeyFrames;
    map = BuildMap(scene, builder);
    for (size_t view = kNumKeyFrames; view < kNumViews; ++view) between.push_back(FrameOfView(scene, view));
  }
  Frame Last() const {
    const KeyFrame& keyframe = map.keyframe(scene.views[kNumKeyFrames - 1].data->id);
    Frame frame = FrameOfView(scene, kNumKeyFrames - 1);
    frame.camera_from_map = keyframe.camera_from_map;
    frame.landmarks = keyframe.landmarks.ByFeature();
    return frame;
  }
};

TEST(Backfill, LocalisesOneFrameAfterAnother) {
  Setting s;
  s.backfill.Start(s.Last(), s.between);
  for (size_t view = kNumKeyFrames; view < kNumViews; ++view) {
    ASSERT_FALSE(s.backfill.IsDone());
    const std::optional<Frame> frame = s.backfill.Next(s.map);
    ASSERT_TRUE(frame) << view;
    EXPECT_EQ(frame->number, view);
    const Rigid3d& truth = s.scene.views[view].camera_from_world;
    EXPECT_LT(frame->camera_from_map.rotation.angularDistance(truth.rotation), 1e-4);
    EXPECT_LT((frame->camera_from_map.TargetOriginInSource() - truth.TargetOriginInSource()).norm(), 1e-3);
  }
  EXPECT_TRUE(s.backfill.IsDone());
  EXPECT_FALSE(s.backfill.Next(s.map));
}

TEST(Backfill, PassesOverAFrameThatShowsSomethingElseAndGoesOnFromTheLastOne) {
  Setting s;
  SyntheticSceneOptions options = s.scene.options;
  options.seed = 2;
  s.between[1] = FrameOfView(MakeSyntheticScene(options), kNumKeyFrames + 1);
  s.backfill.Start(s.Last(), s.between);
  EXPECT_TRUE(s.backfill.Next(s.map));
  EXPECT_FALSE(s.backfill.Next(s.map));
  const std::optional<Frame> frame = s.backfill.Next(s.map);
  ASSERT_TRUE(frame);
  EXPECT_EQ(frame->number, kNumKeyFrames + 2);
}

TEST(Backfill, ANewStartForgetsWhatWasLeft) {
  Setting s;
  s.backfill.Start(s.Last(), s.between);
  s.backfill.Start(s.Last(), {s.between[0]});
  EXPECT_TRUE(s.backfill.Next(s.map));
  EXPECT_TRUE(s.backfill.IsDone());
}

}  // namespace
}  // namespace portolan
