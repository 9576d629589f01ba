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
  EXPECT_FALSE(first.candidates.empty());
  EXPECT_EQ(first.consistent, 0);
  ASSERT_EQ(first.refusals.size(), first.candidates.size()) << "each with its reason";
  EXPECT_EQ(first.refusals.front().kind, RefusalKind::kInconsistent);
  EXPECT_EQ(first.refusals.front().candidate, first.candidates.front().keyframe);
  EXPECT_EQ(first.refusals.front().stamp, passes_.second.views[5].data->stamp);
  EXPECT_GT(Detect(&detector, 6).consistent, 0);
}

TEST_F(LoopDetectorTest, CandidatesBeyondThoseVerifiedAreRefused) {
  LoopDetectorOptions options;
  options.consistent_rounds = 0;
  options.max_verified = 1;
  options.candidates.min_score = 0.01;
  options.candidates.neighbours = 1;  // small groups: many candidates
  LoopDetector detector(options);
  const LoopDetection detection = Detect(&detector, 8);
  ASSERT_GT(detection.candidates.size(), 1u);
  size_t surplus = 0;
  for (const LoopRefusal& refusal : detection.refusals) surplus += refusal.kind == RefusalKind::kSurplus ? 1 : 0;
  EXPECT_EQ(surplus, detection.candidates.size() - 1);
}

/// The map was corrected between two keyframes that see the same place again.
class MovedMapLoopDetectorTest : public LoopDetectorTest {
 protected:
  static LoopDetectorOptions Options() {
    LoopDetectorOptions options;
    options.consistent_rounds = 0;
    return options;
  }
  static Map Moved(const TwoPasses& passes) {
    Map map = BuildMap(passes.first);
    AddPass(passes.second, Sim3d(1, Eigen::Quaterniond::Identity(), {0, 0, 2}) * LoopDrift(), &map);
    return map;
  }
  const Map moved_ = Moved(passes_);
  LoopDetector detector_{Options()};
};

TEST_F(MovedMapLoopDetectorTest, WhatContradictsIsRefusedAndNotConfirmed) {
  ASSERT_TRUE(Detect(&detector_, 8).confirmed);
  const LoopDetection detection = detector_.Detect(moved_, Second(9), index_, &times_);
  EXPECT_FALSE(detection.confirmed);
  EXPECT_FALSE(detection.loop);
  ASSERT_FALSE(detection.refusals.empty());
  EXPECT_EQ(detection.refusals.back().kind, RefusalKind::kContradicted);
  EXPECT_THAT(detection.refusals.back().reason, HasSubstr("contradicts"));
}

TEST_F(MovedMapLoopDetectorTest, WhatWasMeasuredInTheMapAsItWasIsForgotten) {
  ASSERT_TRUE(Detect(&detector_, 8).confirmed);
  detector_.ForgetConfirmations();
  EXPECT_TRUE(detector_.Detect(moved_, Second(9), index_, &times_).confirmed);
  EXPECT_TRUE(detector_.Detect(moved_, Second(10), index_, &times_).loop);
}

TEST_F(LoopDetectorTest, WordsOfTheKeyFramesBeforeAreKeptWhenTheMapMoves) {
  LoopDetector detector{LoopDetectorOptions()};
  Detect(&detector, 5);
  detector.ForgetConfirmations();
  EXPECT_GT(Detect(&detector, 6).consistent, 0);
  detector.Reset();
  EXPECT_EQ(Detect(&detector, 7).consistent, 0);
}

TEST_F(LoopDetectorTest, RefusesDriftThatIsNotBelieved) {
  LoopDetectorOptions options;
  options.consistent_rounds = 0;
  options.max_scale_change = 1.1;
  LoopDetector by_scale(options);
  const LoopDetection detection = Detect(&by_scale, 8);
  EXPECT_FALSE(detection.confirmed);
  ASSERT_FALSE(detection.refusals.empty());
  EXPECT_EQ(detection.refusals.front().kind, RefusalKind::kDrift);
  EXPECT_THAT(detection.refusals.front().reason, HasSubstr("scale would change by 0.83"));
}

TEST_F(LoopDetectorTest, ConnectedKeyFramesAreNoCandidates) {
  const Map map = BuildMap(passes_.first);  // every view sees what the others see
  const KeyFrameIndex index = Index(map);
  LoopDetector detector{LoopDetectorOptions()};
  for (const auto& [id, keyframe] : map.keyframes())
    EXPECT_TRUE(detector.Detect(map, id, index, &times_).candidates.empty());
}

TEST_F(LoopDetectorTest, SmallMapsAreLeft) {
  LoopDetectorOptions options;
  options.consistent_rounds = 0;
  options.min_keyframes = static_cast<int>(map_.keyframes().size()) + 1;
  LoopDetector detector(options);
  EXPECT_TRUE(Detect(&detector, 8).candidates.empty());
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
