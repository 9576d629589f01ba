#include "map_optimization/reprojection_error.h"

#include <gtest/gtest.h>

#include "testing/map_builder.h"
#include "testing/synthetic_scene.h"

namespace portolan {
namespace {

TEST(MeanReprojectionLoss, OfAnExactMapIsNone) {
  EXPECT_LT(MeanReprojectionLoss(BuildMap(MakeSyntheticScene(SyntheticSceneOptions()))), 1e-6);
}

TEST(MeanReprojectionLoss, RisesWithTheNoise) {
  double last = 0;
  for (const double sigma : {0.002, 0.01, 0.05}) {
    MapBuilderOptions options;
    options.point_sigma = sigma;
    const double loss = MeanReprojectionLoss(BuildMap(MakeSyntheticScene(SyntheticSceneOptions()), options));
    EXPECT_GT(loss, 1.2 * last);
    last = loss;
  }
}

TEST(MeanReprojectionLoss, DoesNotDependOnFrameAndScale) {
  MapBuilderOptions options;
  options.point_sigma = 0.01;
  const SyntheticScene scene = MakeSyntheticScene(SyntheticSceneOptions());
  const double expected = MeanReprojectionLoss(BuildMap(scene, options));
  options.map_from_world = Sim3d(3, ExpSO3({1, 0.2, 0.3}), {3, 2, 1});
  options.point_sigma = 0.03;
  EXPECT_NEAR(MeanReprojectionLoss(BuildMap(scene, options)), expected, 0.02 * expected);
}

TEST(MeanReprojectionLoss, APointBehindACameraIsAsBadAsAGrossOutlier) {
  Map map = BuildMap(MakeSyntheticScene(SyntheticSceneOptions()));
  const MapPointId point = map.SortedPointIds().front();
  map.SetPosition(point, {0, 0, -5});
  EXPECT_GT(MeanReprojectionLoss(map), 1e-5);
  EXPECT_LT(MeanReprojectionLoss(map), 1.0);
}

TEST(MeanReprojectionLoss, OfAnEmptyMapIsNone) {
  EXPECT_EQ(MeanReprojectionLoss(Map()), 0);
}

}  // namespace
}  // namespace portolan
