#include "tracking/tracked_pair.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <set>

#include "testing/matchers.h"
#include "tracking/synthetic_frame.h"

namespace portolan {
namespace {

/// A camera that goes straight ahead; a part of what it sees are landmarks of a map.
class TrackedPairTest : public ::testing::Test {
 protected:
  TrackedPairTest() {
    SyntheticSceneOptions options;
    options.motion = CameraMotion::kForward;
    options.num_views = 6;
    options.travel = 1;
    options.pixel_sigma_px = 0.5;
    options.descriptor_flip_ratio = 0.03;
    scene_ = MakeSyntheticScene(options);
    map_ = BuildMap(scene_, MapBuilderOptions());
  }
  /// @param every only every so-manieth landmark is known to be seen.
  Frame Tracked(size_t view, size_t every) const {
    Frame frame = FrameOfView(scene_, view);
    frame.map = map_.id();
    frame.camera_from_map = scene_.views[view].camera_from_world;
    frame.landmarks = TrueLandmarks(scene_, view, map_);
    for (MapPointId& id : frame.landmarks) {
      if (id.sequence() % every != 0) id = MapPointId();
    }
    return frame;
  }

  SyntheticScene scene_;
  Map map_;
  InitializerOptions options_;
};

TEST_F(TrackedPairTest, MatchesLandmarksAndWhatLiesBetweenThem) {
  const Frame first = Tracked(0, 3), second = Tracked(4, 3);
  const auto pair = MakeTrackedPair(map_, first, second, options_);
  ASSERT_TRUE(pair);
  const auto truth = TrueMatches(scene_.views[0], scene_.views[4]);
  size_t right = 0;
  for (const auto& match : pair->matches) right += std::count(truth.begin(), truth.end(), match);
  EXPECT_GE(right, pair->matches.size() * 95 / 100);
  size_t landmarks = 0;
  for (const MapPointId id : first.landmarks) landmarks += id.IsValid() ? 1 : 0;
  EXPECT_GT(pair->matches.size(), landmarks * 3 / 2) << "of " << truth.size();
  const Rigid3d motion = second.camera_from_map * first.camera_from_map.Inverse();
  EXPECT_THAT(Rigid3d(pair->second_from_first, pair->translation), RigidNear(motion, PoseTolerance()));
  EXPECT_EQ(pair->first.number, 0u);
  EXPECT_EQ(pair->second.number, 4u);
  EXPECT_GT(pair->baseline_px, 0);
}

TEST_F(TrackedPairTest, EachFeatureIsInOneMatch) {
  const auto pair = MakeTrackedPair(map_, Tracked(0, 2), Tracked(3, 2), options_);
  ASSERT_TRUE(pair);
  std::set<uint32_t> first, second;
  for (const auto& [i, j] : pair->matches) {
    EXPECT_TRUE(first.insert(i).second);
    EXPECT_TRUE(second.insert(j).second);
  }
}

TEST_F(TrackedPairTest, TooFewMatchesAreNoPair) {
  options_.min_matches = 5000;
  EXPECT_FALSE(MakeTrackedPair(map_, Tracked(0, 1), Tracked(4, 1), options_));
}

}  // namespace
}  // namespace portolan
