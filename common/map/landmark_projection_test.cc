#include "map/landmark_projection.h"

#include <gtest/gtest.h>

#include "testing/map_builder.h"

namespace portolan {
namespace {

TEST(LandmarkProjectionTest, PredictsPixelAndOctaveOfWhatAKeyFrameSees) {
  const SyntheticScene scene = MakeSyntheticScene(SyntheticSceneOptions());
  const Map map = BuildMap(scene);
  int predicted_count = 0;
  for (const auto& [id, keyframe] : map.keyframes()) {
    const KeyFrameData& data = *keyframe.data;
    const LandmarkProjection projection(data.camera, data.pyramid, keyframe.camera_from_map);
    for (size_t f = 0; f < keyframe.landmarks.num_features(); ++f) {
      if (!keyframe.landmarks[f].IsValid()) continue;
      const auto predicted = projection.Predict(map.point(keyframe.landmarks[f]));
      if (!predicted) continue;  // on the image border
      ++predicted_count;
      EXPECT_LT((predicted->pixel_px - data.features.pixels_px[f].cast<double>()).norm(), 1e-2);
      EXPECT_NEAR(predicted->octave, data.features.octaves[f], 1);
    }
  }
  EXPECT_GT(predicted_count, 3000);  // 10 views of most of 500 landmarks
}

TEST(LandmarkProjectionTest, RefusesWhatCannotBeSeen) {
  MapPoint point;
  point.position_in_map = {0, 0, 4};
  point.mean_viewing_direction = {0, 0, 1};
  point.min_distance = 2;
  point.max_distance = 8;
  const PinholeCamera camera{500, 500, 319.5, 239.5, 640, 480};
  const ScalePyramid pyramid;
  const auto sees_from = [&](const Eigen::Vector3d& rotation, const Eigen::Vector3d& centre) {
    const Rigid3d map_from_camera(ExpSO3(rotation), centre);
    return LandmarkProjection(camera, pyramid, map_from_camera.Inverse()).Predict(point).has_value();
  };
  EXPECT_TRUE(sees_from({0, 0, 0}, {0, 0, 0}));
  EXPECT_FALSE(sees_from({0, 0, 0}, {0, 0, 6})) << "behind the camera";
  EXPECT_FALSE(sees_from({0, M_PI, 0}, {0, 0, 8})) << "from behind the landmark";
  EXPECT_FALSE(sees_from({0, 0, 0}, {3, 0, 0})) << "outside the image";
  EXPECT_FALSE(sees_from({0, 0, 0}, {0, 0, -6})) << "too far";
  EXPECT_FALSE(sees_from({0, 0, 0}, {0, 0, 2.5})) << "too near";
  EXPECT_FALSE(sees_from({0, -1.2, 0}, {3.73, 0, 2.56})) << "from the side, 69 degrees";
  EXPECT_TRUE(sees_from({0, -0.8, 0}, {2.87, 0, 1.21})) << "46 degrees";
}

}  // namespace
}  // namespace portolan
