#include "map/keyframe_view.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "map/map.h"
#include "testing/map_builder.h"
#include "testing/synthetic_scene.h"

namespace portolan {
namespace {

TEST(KeyFrameView, PredictsPixelAndOctaveOfWhatItSees) {
  const Map map = BuildMap(MakeSyntheticScene(SyntheticSceneOptions()));
  int predicted_count = 0;
  for (const auto& [id, keyframe] : map.keyframes()) {
    const KeyFrameView view(keyframe);
    for (uint32_t f = 0; f < keyframe.landmarks.num_features(); ++f) {
      if (view.IsFree(f)) continue;
      const auto predicted = view.Predict(map.point(keyframe.landmarks[f]));
      if (!predicted) continue;  // on the image border
      ++predicted_count;
      EXPECT_LT((predicted->pixel_px - view.Pixel(f)).norm(), 1e-2);
      EXPECT_NEAR(predicted->octave, keyframe.data->features.octaves[f], 1);
    }
  }
  EXPECT_GT(predicted_count, 300);
}

TEST(KeyFrameView, RefusesWhatCannotBeSeen) {
  const Map map = BuildMap(MakeSyntheticScene(SyntheticSceneOptions()));
  MapPoint point = map.point(map.SortedPointIds().front());
  const auto sees_from = [&](const Rigid3d& camera_from_map) {
    KeyFrame keyframe = map.keyframes().begin()->second;
    keyframe.camera_from_map = camera_from_map;
    return KeyFrameView(keyframe).Predict(point).has_value();
  };
  const Eigen::Vector3d at = point.position_in_map.cast<double>();
  const Eigen::Vector3d direction = point.mean_viewing_direction.cast<double>();
  // Cameras that look straight at the point from its mean viewing direction, turned and moved.
  const Eigen::Quaterniond looks = Eigen::Quaterniond::FromTwoVectors(direction, Eigen::Vector3d::UnitZ());
  const auto camera = [&](const Eigen::Quaterniond& rotation, double distance) {
    return Rigid3d(rotation, -(rotation * at) + Eigen::Vector3d(0, 0, distance));
  };
  const double distance = 0.5 * static_cast<double>(point.min_distance + point.max_distance);
  EXPECT_TRUE(sees_from(camera(looks, distance)));
  EXPECT_FALSE(sees_from(camera(looks, -distance))) << "behind the camera";
  EXPECT_FALSE(sees_from(camera(looks, 2.0 * static_cast<double>(point.max_distance)))) << "too far";
  EXPECT_FALSE(sees_from(camera(looks, 0.4 * static_cast<double>(point.min_distance)))) << "too near";
  EXPECT_FALSE(sees_from(camera(ExpSO3({0, 1.4, 0}) * looks, distance))) << "from the side, 80 degrees";
  Rigid3d aside = camera(looks, distance);
  aside.rotation = ExpSO3({0, 1.4, 0}) * aside.rotation;
  aside.translation = ExpSO3({0, 1.4, 0}) * aside.translation;
  EXPECT_FALSE(sees_from(aside)) << "outside the image";
}

}  // namespace
}  // namespace portolan
