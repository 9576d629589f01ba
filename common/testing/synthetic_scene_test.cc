#include "testing/synthetic_scene.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <set>

namespace portolan {
namespace {

TEST(SyntheticScene, FeaturesAreTheProjectionsOfTheirLandmarks) {
  for (const LandmarkLayout layout : {LandmarkLayout::kGeneral, LandmarkLayout::kPlanar, LandmarkLayout::kFar}) {
    for (const CameraMotion motion :
         {CameraMotion::kSideways, CameraMotion::kForward, CameraMotion::kOrbit, CameraMotion::kPureRotation}) {
      SyntheticSceneOptions options;
      options.landmarks = layout;
      options.motion = motion;
      const SyntheticScene scene = MakeSyntheticScene(options);
      ASSERT_EQ(scene.views.size(), 10u);
      for (const SyntheticView& view : scene.views) {
        EXPECT_GT(view.data->features.size(), 100u) << static_cast<int>(layout) << " " << static_cast<int>(motion);
        for (size_t i = 0; i < view.data->features.size(); ++i) {
          const size_t landmark = static_cast<size_t>(view.landmark_of_feature[i]);
          const Eigen::Vector2d pixel =
              options.camera.Project(view.camera_from_world * scene.landmarks_in_world[landmark]);
          ASSERT_LT((view.data->features.pixels_px[i].cast<double>() - pixel).norm(), 1e-4);
          ASSERT_EQ(view.data->features.descriptors[i], scene.descriptors[landmark]);
        }
      }
    }
  }
}

TEST(SyntheticScene, OctavesRiseAsTheCameraComesCloser) {
  SyntheticSceneOptions options;
  options.motion = CameraMotion::kForward;
  options.travel = 2.0;
  const SyntheticScene scene = MakeSyntheticScene(options);
  double change = 0;
  const auto matches = TrueMatches(scene.views.front(), scene.views.back());
  ASSERT_GT(matches.size(), 50u);
  for (const auto& [first, last] : matches) {
    change += scene.views.back().data->features.octaves[last] - scene.views.front().data->features.octaves[first];
  }
  EXPECT_GT(change / static_cast<double>(matches.size()), 0.5);
}

TEST(SyntheticScene, NoiseOutliersClutterAndFlipsComeAsOrdered) {
  SyntheticSceneOptions options;
  options.num_landmarks = 2000;
  options.num_views = 1;
  options.pixel_sigma_px = 0.5;
  options.outlier_ratio = 0.3;
  options.descriptor_flip_ratio = 0.05;
  options.num_clutter = 200;
  const SyntheticScene scene = MakeSyntheticScene(options);
  const SyntheticView& view = scene.views[0];
  const FeatureSet& features = view.data->features;
  double squares = 0, flips = 0;
  int inliers = 0, outliers = 0, clutter = 0;
  for (size_t i = 0; i < features.size(); ++i) {
    if (view.landmark_of_feature[i] == kNoLandmark) {
      ++clutter;
      continue;
    }
    const size_t landmark = static_cast<size_t>(view.landmark_of_feature[i]);
    flips += HammingDistance(features.descriptors[i], scene.descriptors[landmark]);
    if (view.is_outlier[i]) {
      ++outliers;
      continue;
    }
    ++inliers;
    const Eigen::Vector2d pixel = options.camera.Project(view.camera_from_world * scene.landmarks_in_world[landmark]);
    squares +=
        ((features.pixels_px[i].cast<double>() - pixel) / ScalePyramid().Scale(features.octaves[i])).squaredNorm() / 2;
  }
  const double seen = inliers + outliers;
  EXPECT_EQ(clutter, 200);
  EXPECT_NEAR(outliers / seen, 0.3, 4 * std::sqrt(0.3 * 0.7 / seen));
  EXPECT_NEAR(std::sqrt(squares / inliers), 0.5, 4 * 0.5 / std::sqrt(4.0 * inliers));
  EXPECT_NEAR(flips / seen / 256, 0.05, 4 * std::sqrt(0.05 * 0.95 / (256 * seen)));
}

TEST(SyntheticScene, DescriptorsAreUnlikeEachOther) {
  const SyntheticScene scene = MakeSyntheticScene(SyntheticSceneOptions());
  int closest = 256;
  for (size_t i = 0; i < scene.descriptors.size(); ++i) {
    for (size_t j = i + 1; j < scene.descriptors.size(); ++j) {
      closest = std::min(closest, HammingDistance(scene.descriptors[i], scene.descriptors[j]));
    }
  }
  EXPECT_GT(closest, 80);
}

TEST(SyntheticScene, PlanarLandmarksLieOnAPlaneAndGeneralOnesDoNot) {
  const auto thickness = [](LandmarkLayout layout) {
    SyntheticSceneOptions options;
    options.landmarks = layout;
    const SyntheticScene scene = MakeSyntheticScene(options);
    Eigen::Matrix3Xd points(3, static_cast<Eigen::Index>(scene.landmarks_in_world.size()));
    for (Eigen::Index i = 0; i < points.cols(); ++i) points.col(i) = scene.landmarks_in_world[static_cast<size_t>(i)];
    points.colwise() -= points.rowwise().mean().eval();
    return Eigen::Matrix3d(points * points.transpose()).jacobiSvd().singularValues()(2);
  };
  EXPECT_LT(thickness(LandmarkLayout::kPlanar), 1e-9);
  EXPECT_GT(thickness(LandmarkLayout::kGeneral), 100);
}

TEST(SyntheticScene, PureRotationDoesNotMoveTheCamera) {
  SyntheticSceneOptions options;
  options.motion = CameraMotion::kPureRotation;
  const SyntheticScene scene = MakeSyntheticScene(options);
  for (const SyntheticView& view : scene.views) EXPECT_LT(view.camera_from_world.TargetOriginInSource().norm(), 1e-12);
  EXPECT_GT(scene.views[0].camera_from_world.rotation.angularDistance(scene.views[9].camera_from_world.rotation), 0.3);
}

TEST(SyntheticScene, AStreetIsSeenAgainAfterALap) {
  SyntheticSceneOptions options;
  options.landmarks = LandmarkLayout::kStreet;
  options.motion = CameraMotion::kStreetLap;
  options.num_landmarks = 1000;
  options.num_views = 51;
  options.lap = 20;
  options.travel = 25;  // views 0.5 apart
  options.sight = 6;
  const SyntheticScene scene = MakeSyntheticScene(options);
  EXPECT_LT((scene.views[45].camera_from_world.TargetOriginInSource() -
             scene.views[5].camera_from_world.TargetOriginInSource())
                .norm(),
            1e-9);
  EXPECT_GT(TrueMatches(scene.views[45], scene.views[5]).size(), 50u);
  EXPECT_GT(TrueMatches(scene.views[20], scene.views[21]).size(), 30u);
  EXPECT_EQ(TrueMatches(scene.views[0], scene.views[20]).size(), 0u);
}

TEST(SyntheticScene, SameSeedSameSceneAndFeatureNumbersDoNotTell) {
  SyntheticSceneOptions options;
  options.pixel_sigma_px = 1;
  const SyntheticScene a = MakeSyntheticScene(options), b = MakeSyntheticScene(options);
  for (size_t i = 0; i < a.views.size(); ++i) {
    EXPECT_EQ(a.views[i].landmark_of_feature, b.views[i].landmark_of_feature);
    EXPECT_EQ(a.views[i].data->features.pixels_px, b.views[i].data->features.pixels_px);
    EXPECT_EQ(a.ViewOf(a.views[i].data->id), i);
  }
  int same = 0;
  const auto matches = TrueMatches(a.views[0], a.views[1]);
  for (const auto& [i, j] : matches) same += i == j;
  EXPECT_LT(same, 20);
  EXPECT_GT(matches.size(), 200u);
}

TEST(LookAt, HasTheTargetInTheMiddleAndDownBelow) {
  const Rigid3d camera_from_world = LookAt({1, 2, 3}, {4, 1, 9});
  const Eigen::Vector3d target = camera_from_world * Eigen::Vector3d(4, 1, 9);
  EXPECT_LT(target.head<2>().norm(), 1e-12);
  EXPECT_GT(target.z(), 0);
  EXPECT_GT((camera_from_world.rotation * Eigen::Vector3d::UnitY()).y(), 0.9);
  EXPECT_LT((camera_from_world.TargetOriginInSource() - Eigen::Vector3d(1, 2, 3)).norm(), 1e-12);
}

}  // namespace
}  // namespace portolan
