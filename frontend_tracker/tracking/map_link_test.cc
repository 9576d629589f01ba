#include "tracking/map_link.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "base/random.h"
#include "testing/matchers.h"
#include "tracking/synthetic_frame.h"

namespace portolan {
namespace {

/// One scene, mapped twice: as it is, and turned, shifted and with another scale. Frames see it exactly.
class MapLinkTest : public ::testing::Test {
 protected:
  MapLinkTest() {
    SyntheticSceneOptions options;
    options.num_views = 6;
    scene_ = MakeSyntheticScene(options);
    MapBuilderOptions builder;
    other_ = BuildMap(scene_, builder);
    builder.map_from_world = map_from_other_;
    map_ = BuildMap(scene_, builder);
  }
  Overlap OverlapOfView(size_t view) const {
    const Rigid3d camera_from_other = scene_.views[view].camera_from_world;
    const auto in_map = TrueLandmarks(scene_, view, map_), in_other = TrueLandmarks(scene_, view, other_);
    return MakeOverlap({map_, TransformPose(camera_from_other, map_from_other_), in_map},
                       {other_, camera_from_other, in_other});
  }

  const Sim3d map_from_other_{2.7, ExpSO3({0.3, -0.8, 0.5}), {4, -2, 7}};
  SyntheticScene scene_;
  Map map_, other_;
};

TEST_F(MapLinkTest, OneFrameTellsTheSimilarity) {
  const auto link = MeasureLink({OverlapOfView(2)});
  ASSERT_TRUE(link);
  EXPECT_THAT(*link, Sim3Near(map_from_other_, (PoseTolerance{1e-5, 1e-4}), 1e-5));
}

TEST_F(MapLinkTest, AThirdOfBadDepthsDoesNoHarm) {
  Overlap overlap = OverlapOfView(1);
  ASSERT_GT(overlap.depths.size(), 60u);
  Random random(3);
  for (size_t i = 0; i < overlap.depths.size(); ++i) {
    overlap.depths[i].first *= 1 + 0.01 * random.Gaussian();  // of each point's own depth
    if (i % 3 == 0) overlap.depths[i].first *= 5;             // landmarks that are wrong
  }
  const auto link = MeasureLink({overlap});
  ASSERT_TRUE(link);
  // A third on one side moves the median to the three-quarter quantile of the rest: 0.7 sigma.
  EXPECT_NEAR(link->scale / map_from_other_.scale, 1, 0.01);
  EXPECT_LT(link->rotation.angularDistance(map_from_other_.rotation), 1e-6) << "depths tell the scale alone";
}

TEST_F(MapLinkTest, AFrameThatIsWronglyLocalisedIsOutvoted) {
  std::vector<Overlap> overlaps = {OverlapOfView(0), OverlapOfView(1), OverlapOfView(2), OverlapOfView(3)};
  overlaps[0].camera_from_map = Rigid3d(ExpSO3({0, 0.3, 0}), {1, 0, 0}) * overlaps[0].camera_from_map;
  for (auto& [in_map, in_other] : overlaps[1].depths) in_map *= 1.6;  // and one with a wrong scale
  const auto link = MeasureLink(overlaps);
  ASSERT_TRUE(link);
  EXPECT_THAT(*link, Sim3Near(map_from_other_, (PoseTolerance{1e-5, 1e-3}), 1e-4));
}

TEST_F(MapLinkTest, AWayTellsTheScaleBetterThanDepthsThatErrToOneSide) {
  std::vector<Overlap> overlaps;
  for (size_t view = 0; view < 6; ++view) {
    overlaps.push_back(OverlapOfView(view));
    for (auto& [in_map, in_other] : overlaps.back().depths) in_map *= 1.05;
  }
  // One is wrong.
  overlaps[2].camera_from_map = Rigid3d(Eigen::Quaterniond::Identity(), {0.5, 0, 0}) * overlaps[2].camera_from_map;
  const auto link = MeasureLink(overlaps);
  ASSERT_TRUE(link);
  EXPECT_NEAR(link->scale / map_from_other_.scale, 1, 1e-3);
  // On the spot it tells nothing.
  const auto still = MeasureLink({overlaps[0], overlaps[0], overlaps[0], overlaps[0], overlaps[0], overlaps[0]});
  ASSERT_TRUE(still);
  EXPECT_NEAR(still->scale / map_from_other_.scale, 1.05, 1e-3);
}

TEST_F(MapLinkTest, FewFeaturesThatBothMapsKnowMustAgree) {
  Overlap overlap = OverlapOfView(2);
  overlap.depths.resize(kMinOverlapFeatures - 1);
  EXPECT_TRUE(MeasureLink({overlap}));
  overlap.depths.resize(kFewOverlapFeatures);
  EXPECT_TRUE(MeasureLink({overlap}));
  overlap.depths.pop_back();
  EXPECT_FALSE(MeasureLink({overlap})) << "too few, however well they agree";
  EXPECT_FALSE(MeasureLink({}));

  Overlap doubtful = OverlapOfView(2);
  doubtful.depths.resize(12);
  for (size_t i = 0; i < doubtful.depths.size(); ++i) doubtful.depths[i].first *= 1 + 0.1 * static_cast<double>(i);
  EXPECT_FALSE(MeasureLink({doubtful}));
  // Another frame decides then.
  const auto link = MeasureLink({doubtful, OverlapOfView(3)});
  ASSERT_TRUE(link);
  EXPECT_NEAR(link->scale / map_from_other_.scale, 1, 1e-4);
}

TEST_F(MapLinkTest, LandmarksThatAreGoneOrBehindTheCameraDoNotCount) {
  const size_t all = OverlapOfView(2).depths.size();
  const auto landmarks = TrueLandmarks(scene_, 2, map_);
  const auto first = std::find_if(landmarks.begin(), landmarks.end(), [](MapPointId id) { return id.IsValid(); });
  map_.RemovePoint(*first);
  auto in_map = landmarks;
  const auto in_other = TrueLandmarks(scene_, 2, other_);
  const Rigid3d camera_from_other = scene_.views[2].camera_from_world;
  EXPECT_EQ(MakeOverlap({map_, TransformPose(camera_from_other, map_from_other_), in_map},
                        {other_, camera_from_other, in_other})
                .depths.size(),
            all - 1);
  const Rigid3d looking_away = Rigid3d(ExpSO3({0, M_PI, 0}), Eigen::Vector3d::Zero()) * camera_from_other;
  EXPECT_TRUE(MakeOverlap({map_, looking_away, in_map}, {other_, looking_away, in_other}).depths.empty());
}

TEST_F(MapLinkTest, KeepsTheCameraWhereItIs) {
  const Rigid3d camera_from_other = scene_.views[4].camera_from_world;
  const Rigid3d camera_from_map(ExpSO3({0.1, 0.2, 0.3}), {3, 2, 1});
  const Sim3d link = LinkThroughCamera(camera_from_map, camera_from_other, 1.7);
  EXPECT_NEAR(link.scale, 1.7, 1e-12);
  EXPECT_THAT(TransformPose(camera_from_other, link), RigidNear(camera_from_map, PoseTolerance()));
}

}  // namespace
}  // namespace portolan
