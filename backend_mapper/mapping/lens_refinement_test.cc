#include "mapping/lens_refinement.h"

#include <gtest/gtest.h>

#include <cmath>

#include "geometry/sim3_alignment.h"
#include "map_optimization/global_bundle_adjustment.h"
#include "map_optimization/map_correction.h"
#include "mapping/mapping_test_scene.h"

namespace portolan {
namespace {

LensFinding FindInMap(const Map& map, const LensRefinementOptions& options) {
  return FindRadialResidual(MakeLensProblem(map, options), options);
}

/// Views along a winding path, seen through a lens that the calibration does not know. @param turning factor of the
/// camera's turns.
Map MapThrough(const RadialResidual& lens, double pixel_sigma, double turning = 1) {
  TestSceneOptions options;
  options.pixel_sigma = pixel_sigma;
  TestScene scene(options);
  std::vector<TestView> views;
  for (int i = 0; i < 16; ++i) {
    views.push_back(
        scene.See(CameraAt({0.15 * i, 0.1 * (i % 4), 0.1 * i},
                           {turning * 0.03 * (i % 5), turning * (0.06 * (i % 7) - 0.2), turning * 0.02 * i})));
  }
  for (TestView& view : views) {
    KeyFrameData data = *view.data;
    for (Eigen::Vector2f& pixel : data.features.pixels_px) {
      const Eigen::Vector2d xy = lens.Distort(data.camera.Normalize(pixel.cast<double>()));
      pixel = Eigen::Vector2d(data.camera.fx * xy.x() + data.camera.cx, data.camera.fy * xy.y() + data.camera.cy)
                  .cast<float>();
    }
    view.data = std::make_shared<const KeyFrameData>(std::move(data));
  }
  return BuildTrueMap(scene, views);
}

TEST(LensRefinementTest, FindsWhatTheCalibrationLeft) {
  const RadialResidual lens{0.06, -0.09};
  const auto found = FindInMap(MapThrough(lens, 0.3), {});
  EXPECT_NEAR(found.residual.Distort({0.6, 0}).x(), lens.Distort({0.6, 0}).x(), 1e-3);  // half a pixel at the rim
}

/// The distance of the camera centres of a map from those of another, RMS after alignment, in units of the second.
double CentreError(const Map& map, const Map& truth) {
  std::vector<Eigen::Vector3d> found, true_centres;
  for (const auto& [id, keyframe] : map.keyframes()) {
    found.push_back(keyframe.camera_from_map.TargetOriginInSource());
    true_centres.push_back(truth.keyframe(id).camera_from_map.TargetOriginInSource());
  }
  const auto aligned = AlignPoints(found, true_centres);
  EXPECT_TRUE(aligned.ok());
  double sum = 0;
  for (size_t i = 0; i < found.size(); ++i) sum += (*aligned * found[i] - true_centres[i]).squaredNorm();
  return std::sqrt(sum / static_cast<double>(found.size()));
}

TEST(LensRefinementTest, AMapMadeThroughTheWrongLensComesRight) {
  const RadialResidual lens{0.06, -0.09};
  const Map truth = MapThrough(lens, 0);  // noise would hide what the lens does to these few views
  // As a mapper that doesn't know the lens would have it.
  const auto wrong = AdjustGlobally(truth, {}, nullptr, nullptr);
  ASSERT_TRUE(wrong.ok()) << wrong.error().message;
  Map map = truth;
  ASSERT_TRUE(ApplyMapCorrection(*wrong, &map).ok());
  static_cast<void>(map.TakeDelta());
  const double error_before = CentreError(map, truth);

  MapCorrection adaptation = AdaptToResidual(map, {map.keyframes().rbegin()->second.data->camera, lens}, nullptr);
  ASSERT_TRUE(ApplyMapCorrection(adaptation, &map).ok());
  EXPECT_LT(CentreError(map, truth), 0.3 * error_before);
}

TEST(LensRefinementTest, ABetterEstimateReplacesTheKnownOne) {
  const RadialResidual lens{0.06, -0.09}, known{0.05, -0.04};
  Map map = MapThrough(lens, 0.3);
  map.SetResidual(map.keyframes().begin()->second.data->camera, known);
  const LensProblem problem = MakeLensProblem(map, {});
  EXPECT_EQ(problem.known, known);
  const RadialResidual found = FindRadialResidual(problem, {}).residual;
  EXPECT_NEAR(found.Distort({0.6, 0}).x(), lens.Distort({0.6, 0}).x(), 1e-3);
  LensRefinementOptions sceptical;
  sceptical.min_evidence = 1e6;
  EXPECT_TRUE(FindRadialResidual(problem, sceptical).residual.IsNone()) << "it must be as certain as the first";
  map.SetResidual(map.keyframes().begin()->second.data->camera, lens);
  EXPECT_TRUE(FindRadialResidual(MakeLensProblem(map, {}), {}).residual.IsNone()) << "there is nothing new";
}

TEST(LensRefinementTest, LeavesAnExactCalibrationAlone) {
  EXPECT_TRUE(FindInMap(MapThrough({}, 0.3), {}).residual.IsNone());
}

/// The same keyframes and points, with a calibration whose focal length is wrong by this factor.
Map WithFocalLength(double factor, const Map& map) {
  Map longer(map.id());
  for (const auto& [id, keyframe] : map.keyframes()) {
    KeyFrameData data = *keyframe.data;
    data.camera.fx *= factor;
    data.camera.fy *= factor;
    longer.AddKeyFrame(std::make_shared<const KeyFrameData>(std::move(data)), keyframe.camera_from_map,
                       keyframe.parent);
  }
  for (const MapPointId id : map.SortedPointIds()) {
    longer.AddPoint(id, map.point(id).position_in_map);
    for (const Observation& o : map.point(id).observations) longer.AddObservation(id, o.keyframe, o.feature);
  }
  return longer;
}

TEST(LensRefinementTest, LeavesAWrongFocalLengthToTheUser) {
  const LensFinding finding = FindInMap(WithFocalLength(1.1, MapThrough({}, 0.3)), {});
  EXPECT_TRUE(finding.residual.IsNone());
  EXPECT_TRUE(finding.is_settled);
}

TEST(LensRefinementTest, LooksAgainWhereLensAndFocalLengthExplainAboutTheSame) {
  const LensFinding finding = FindInMap(WithFocalLength(1.02, MapThrough({0.02, -0.03}, 0.3)), {});
  EXPECT_TRUE(finding.residual.IsNone());
  EXPECT_FALSE(finding.is_settled);
}

TEST(LensRefinementTest, LeavesAloneWhatDoesNoHarm) {
  EXPECT_TRUE(FindInMap(MapThrough({0.002, -0.001}, 0.3), {}).residual.IsNone());  // 0.2 px at the rim
}

TEST(LensRefinementTest, LeavesAloneWhatIsNotCertain) {
  const Map map = MapThrough({0.06, -0.09}, 0.3);
  LensRefinementOptions options;
  options.max_sigma_px = 1e-3;
  EXPECT_TRUE(FindInMap(map, options).residual.IsNone());
  options.max_sigma_px = 1e3;
  EXPECT_FALSE(FindInMap(map, options).residual.IsNone());
}

TEST(LensRefinementTest, AsksForATurn) {
  const Map map = MapThrough({0.06, -0.09}, 0.3, 0.2);  // a fifth: 4 degrees and less
  LensRefinementOptions options;
  EXPECT_TRUE(FindInMap(map, options).residual.IsNone());
  EXPECT_FALSE(FindInMap(map, options).is_settled) << "a map that goes on may turn";
  options.min_turn_deg = 1;
  EXPECT_FALSE(FindInMap(map, options).residual.IsNone());
}

TEST(LensRefinementTest, AsksForEnoughPoints) {
  const Map map = MapThrough({0.06, -0.09}, 0.3);
  LensRefinementOptions options;
  options.max_points = 100;  // of a map that has more
  EXPECT_TRUE(FindInMap(map, options).residual.IsNone());
  EXPECT_TRUE(FindInMap(Map(MapId(1)), {}).residual.IsNone());
}

TEST(LensRefinementTest, PassesOverKeyFramesOfAnotherCamera) {
  const RadialResidual lens{0.06, -0.09};
  Map map = MapThrough(lens, 0.3);
  KeyFrameData other = *map.keyframes().begin()->second.data;
  other.id = KeyFrameId(map.keyframes().rbegin()->first.value + 1);
  other.camera.fx += 100;
  map.AddKeyFrame(std::make_shared<const KeyFrameData>(std::move(other)), Rigid3d(), map.keyframes().begin()->first);
  EXPECT_NEAR(FindInMap(map, {}).residual.k1, lens.k1, 0.01);
}

}  // namespace
}  // namespace portolan
