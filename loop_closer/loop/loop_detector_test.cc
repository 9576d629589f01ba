#include "loop/loop_detector.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "loop/loop_test_scene.h"
#include "testing/matchers.h"

namespace portolan {
namespace {

using ::testing::HasSubstr;

class LoopDetectorTest : public ::testing::Test {
 protected:
  static KeyFrameIndex Index(const Map& map) {
    KeyFrameIndex index;
    for (const auto& [id, keyframe] : map.keyframes()) index.Add(id, WordsOf(keyframe.data));
    return index;
  }
  KeyFrameId Second(size_t view) const { return passes_.second.views[view].data->id; }
  LoopDetection Detect(LoopDetector* detector, size_t view) {
    return detector->Detect(map_, Second(view), index_, &times_);
  }

  const TwoPasses passes_ = MakeTwoPasses(PlaceSceneOptions());
  const Map map_ = MapWithLoop(passes_);
  const KeyFrameIndex index_ = Index(map_);
  StageTimes times_;
};

TEST_F(LoopDetectorTest, BelievesALoopThatTwoKeyFramesSee) {
  LoopDetector detector{LoopDetectorOptions()};
  LoopDetection detection;
  size_t view = 0;
  int confirmed = 0;
  for (; view < passes_.second.views.size() && !detection.loop; ++view) {
    detection = Detect(&detector, view);
    confirmed += detection.confirmed ? 1 : 0;
  }
  ASSERT_TRUE(detection.loop);
  EXPECT_EQ(confirmed, 2);
  EXPECT_GE(view, 3u)
      << "the first keyframe has none before it to be consistent with, the second is the first to be verified";
  EXPECT_EQ(detection.loop->current, Second(view - 1));
  EXPECT_EQ(detection.loop->matched.session(), passes_.first.views[0].data->id.session());
  EXPECT_THAT(detection.loop->corrected_from_map, Sim3Near(LoopDrift().Inverse(), PoseTolerance{1e-3, 1e-2}, 1e-3));
}

TEST_F(LoopDetectorTest, OneKeyFrameIsNotEnoughAndResetForgets) {
  LoopDetectorOptions options;
  options.consistent_rounds = 0;
  LoopDetector detector(options);
  for (size_t view = 5; view < 10; ++view) {
    const LoopDetection detection = Detect(&detector, view);
    EXPECT_TRUE(detection.confirmed) << view;
    EXPECT_FALSE(detection.loop) << view;
    detector.Reset();
  }
}

TEST_F(LoopDetectorTest, ConfirmationsFarApartDoNotAddUp) {
  LoopDetectorOptions options;
  options.consistent_rounds = 0;
  options.max_keyframes_apart = 1;
  LoopDetector detector(options);
  EXPECT_TRUE(Detect(&detector, 5).confirmed);
  // Keyframes of the first pass see nothing again that they are not connected with.
  KeyFrameIndex empty;
  for (size_t view = 6; view < 9; ++view) detector.Detect(map_, Second(view), empty, &times_);
  EXPECT_FALSE(Detect(&detector, 9).loop);
  EXPECT_TRUE(Detect(&detector, 10).loop);
}

TEST_F(LoopDetectorTest, CandidatesMustBeThoseOfTheKeyFramesBefore) {
  LoopDetector detector{LoopDetectorOptions()};
  const LoopDetection first = Detect(&detector, 5);
  EXPECT_GT(first.candidates, 0);
  EXPECT_EQ(first.consistent, 0);
  EXPECT_GT(Detect(&detector, 6).consistent, 0);
}

TEST_F(LoopDetectorTest, RefusesDriftThatIsNotBelieved) {
  LoopDetectorOptions options;
  options.consistent_rounds = 0;
  options.max_scale_change = 1.1;
  LoopDetector by_scale(options);
  const LoopDetection detection = Detect(&by_scale, 8);
  EXPECT_FALSE(detection.confirmed);
  ASSERT_FALSE(detection.refusals.empty());
  EXPECT_THAT(detection.refusals.front().reason, HasSubstr("scale would change by 0.83"));
}

TEST_F(LoopDetectorTest, ConnectedKeyFramesAreNoCandidates) {
  const Map map = BuildMap(passes_.first);  // every view sees what the others see
  const KeyFrameIndex index = Index(map);
  LoopDetector detector{LoopDetectorOptions()};
  for (const auto& [id, keyframe] : map.keyframes()) EXPECT_EQ(detector.Detect(map, id, index, &times_).candidates, 0);
}

TEST_F(LoopDetectorTest, SmallMapsAreLeft) {
  LoopDetectorOptions options;
  options.consistent_rounds = 0;
  options.min_keyframes = static_cast<int>(map_.keyframes().size()) + 1;
  LoopDetector detector(options);
  EXPECT_EQ(Detect(&detector, 8).candidates, 0);
}

TEST_F(LoopDetectorTest, OptionsAreChecked) {
  LoopDetectorOptions options;
  EXPECT_TRUE(options.Check().ok());
  options.max_scale_change = 0.5;
  ASSERT_FALSE(options.Check().ok());
  EXPECT_THAT(options.Check().error().message, HasSubstr("loop.max_scale_change is 0.5, expected above 1"));
}

}  // namespace
}  // namespace portolan
