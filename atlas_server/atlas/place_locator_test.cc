#include "atlas/place_locator.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "atlas/two_maps_test_scene.h"
#include "testing/matchers.h"

namespace portolan {
namespace {

using ::testing::HasSubstr;

class PlaceLocatorTest : public ::testing::Test {
 protected:
  Result<LocatedFrame> Locate(size_t view, const OverlapDetector::EnsureAppearance& ensure = nullptr) {
    const KeyFrameData& frame = *maps_.passes.second.views[view].data;
    return LocateFrame(frame, frame.bow, {maps_.FirstAsOther()}, ensure, options_, &times_);
  }

  const TwoMaps maps_;
  LocatorOptions options_;
  StageTimes times_;
};

TEST_F(PlaceLocatorTest, FindsAFrameThatHasNoMap) {
  for (size_t view = 5; view < 15; ++view) {
    const auto located = Locate(view);
    ASSERT_TRUE(located) << view << ": " << located.error().message;
    EXPECT_EQ(located->map, maps_.first.id());
    EXPECT_GE(located->inliers, options_.min_inliers);
    EXPECT_THAT(located->camera_from_map,
                RigidNear(maps_.passes.second.views[view].camera_from_world, PoseTolerance{0.02, 0.1}));
  }
}

TEST_F(PlaceLocatorTest, RefusesAFrameOfAnotherPlace) {
  SyntheticSceneOptions elsewhere = PlaceSceneOptions();
  elsewhere.seed = 99;
  SyntheticScene scene = MakeSyntheticScene(elsewhere);
  Finish(&scene.views[5], *maps_.passes.vocabulary, nullptr);
  const KeyFrameData& frame = *scene.views[5].data;
  const auto located = LocateFrame(frame, frame.bow, {maps_.FirstAsOther()}, nullptr, options_, &times_);
  ASSERT_FALSE(located.ok());
  EXPECT_THAT(located.error().message, HasSubstr("expected 20"));
}

TEST_F(PlaceLocatorTest, SaysWhenThereIsNothingToCompareWith) {
  const KeyFrameData& frame = *maps_.passes.second.views[5].data;
  const auto located = LocateFrame(frame, frame.bow, {}, nullptr, options_, &times_);
  ASSERT_FALSE(located.ok());
  EXPECT_THAT(located.error().message, HasSubstr("no keyframe"));
  const auto waiting = Locate(5, [](const Map&, const std::vector<KeyFrameId>&) { return false; });
  ASSERT_FALSE(waiting.ok());
  EXPECT_THAT(waiting.error().message, HasSubstr("still being read"));
  OtherMap paged = maps_.FirstAsOther();
  paged.open = [] { return nullptr; };
  const auto unread = LocateFrame(frame, frame.bow, {paged}, nullptr, options_, &times_);
  ASSERT_FALSE(unread.ok());
  EXPECT_THAT(unread.error().message, HasSubstr("still being read"));
}

}  // namespace
}  // namespace portolan
