#include "testing/renderer.h"

#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>
#include <vector>

#include "base/random.h"
#include "base/statistics.h"
#include "testing/synthetic_sequence.h"
#include "testing/texture_painter.h"

namespace portolan {
namespace {

/// Grey value at a sub-pixel location by bilinear interpolation; (0, 0) is the centre of the top-left pixel.
double Grey(const cv::Mat& light, const Eigen::Vector2d& pixel) {
  const int x = static_cast<int>(pixel.x()), y = static_cast<int>(pixel.y());
  const double a = pixel.x() - x, b = pixel.y() - y;
  const auto at = [&](int row, int column) { return static_cast<double>(light.at<float>(row, column)); };
  return (1 - b) * ((1 - a) * at(y, x) + a * at(y, x + 1)) + b * ((1 - a) * at(y + 1, x) + a * at(y + 1, x + 1));
}

/// A white square in the plane x = 0 on nothing but sky, seen from x < 0.
SyntheticWorld WhiteSquare() {
  WorldBuilder builder;
  builder.AddWall({0, 0.5}, {0, -0.5}, -0.5, 0.5, {builder.AddTexture(cv::Mat::ones(64, 64, CV_8UC1) * 10)});
  return builder.Take();
}

TEST(Renderer, PutsAnEdgeWhereTheCameraModelProjectsIt) {
  const SyntheticWorld world = WhiteSquare();
  const PinholeCamera camera = MakeSyntheticCamera(320, 240);
  Renderer renderer(world, camera);
  for (const double shift : {0.0, 0.013, 0.031}) {
    CameraStance stance;
    stance.position_in_world = {-2, shift, 0};
    const Rigid3d world_from_camera = WorldFromCamera(stance);
    const cv::Mat light = renderer.Render(world_from_camera);
    const double left = camera.Project(world_from_camera.Inverse() * Eigen::Vector3d(0, 0.5, 0)).x();
    const double right = camera.Project(world_from_camera.Inverse() * Eigen::Vector3d(0, -0.5, 0)).x();
    // The dark pixels of the middle row add up to the square's width: anti-aliasing keeps areas to a sample's share.
    const int row = 120;
    double width = 0, moment = 0;
    const double sky = light.at<float>(row, 2), dark = light.at<float>(row, 160);
    for (int x = 0; x < camera.width; ++x) {
      const double share = std::max(0.0, (sky - light.at<float>(row, x)) / (sky - dark));
      width += share;
      moment += share * x;
    }
    EXPECT_NEAR(width, right - left, 0.3) << shift;
    EXPECT_NEAR(moment / width, (left + right) / 2, 0.15) << shift;
  }
}

TEST(Renderer, NearerSurfacesHideFartherOnesAndBacksAreInvisible) {
  WorldBuilder builder;
  const int dark = builder.AddTexture(cv::Mat::ones(64, 64, CV_8UC1) * 20);
  const int bright = builder.AddTexture(cv::Mat::ones(64, 64, CV_8UC1) * 200);
  builder.AddWall({3, 1}, {3, -1}, -1, 1, {bright});  // far, drawn first
  builder.AddWall({2, 0}, {2, -1}, -1, 1, {dark});    // near, on the right half
  builder.AddWall({1, -1}, {1, 1}, -1, 1, {bright});  // its back is towards the camera
  const SyntheticWorld world = builder.Take();
  const PinholeCamera camera = MakeSyntheticCamera(320, 240);
  const cv::Mat light = Renderer(world, camera).Render(WorldFromCamera(CameraStance()));
  EXPECT_LT(light.at<float>(120, 200), 25);
  EXPECT_GT(light.at<float>(120, 120), 100);
}

TEST(Renderer, ClipsWhatReachesBehindTheCamera) {
  WorldBuilder builder;
  builder.AddLevel({-50, -50}, {50, 50}, -1, {builder.AddTexture(cv::Mat::ones(64, 64, CV_8UC1) * 40)});
  const SyntheticWorld world = builder.Take();
  const PinholeCamera camera = MakeSyntheticCamera(320, 240);
  const cv::Mat light = Renderer(world, camera).Render(WorldFromCamera(CameraStance()));
  EXPECT_LT(light.at<float>(230, 160), 45);   // the ground
  EXPECT_GT(light.at<float>(100, 160), 150);  // the sky
  EXPECT_GT(light.at<float>(121, 160),
            light.at<float>(130, 160));  // the end of the ground at 50 m lies 5 rows below the horizon
}

TEST(Renderer, SeesWhatARayMeets) {
  SequenceOptions options;
  options.scene = "room";
  options.width = 160;
  options.height = 120;
  options.texture_px = 128;
  const Result<SyntheticSequence> sequence = SyntheticSequence::Make(options);
  ASSERT_TRUE(sequence.ok());
  const SyntheticWorld& world = sequence->world();
  const Rigid3d pose = sequence->frames()[0].world_from_camera;
  const cv::Mat light = Renderer(world, sequence->camera()).Render(pose);
  Random random(1);
  std::vector<double> differences;
  for (int i = 0; i < 500; ++i) {
    const Eigen::Vector2d pixel(static_cast<double>(random.Below(160)), static_cast<double>(random.Below(120)));
    const auto hit = CastRay(world, pose.translation, pose.rotation * sequence->camera().Unproject(pixel));
    ASSERT_TRUE(hit.has_value());  // the room is closed
    const TexturedQuad& quad = world.quads[static_cast<size_t>(hit->quad)];
    const Eigen::Vector3d on_quad = hit->point_in_world - quad.corner_in_world;
    const double a = on_quad.dot(quad.edge_u) / quad.edge_u.squaredNorm(),
                 b = on_quad.dot(quad.edge_v) / quad.edge_v.squaredNorm();
    const Eigen::Vector2d uv = quad.uv_corner + Eigen::Vector2d(a * quad.uv_size.x(), b * quad.uv_size.y());
    const float grey = quad.shade * world.textures[static_cast<size_t>(quad.texture)].Sample(uv.x(), uv.y(), 0.5f);
    differences.push_back(std::abs(grey - light.at<float>(static_cast<int>(pixel.y()), static_cast<int>(pixel.x()))));
  }
  EXPECT_LT(Quantile(differences, 0.5), 2.0);  // the mip level is a guess here, so details differ
}

/// Two frames of a scene without noise and the places that both see.
struct Reprojection {
  std::vector<double> differences, shuffled, shifted;
};

/// Carries pixels of frame a over to frame b by the true surface and poses and compares grey values: at the true place,
/// at the place of another pixel, and half a pixel aside.
Reprojection Reproject(const SyntheticSequence& sequence, size_t a, size_t b) {
  Renderer renderer(sequence.world(), sequence.camera());
  const Rigid3d& pose_a = sequence.frames()[a].world_from_camera;
  const Rigid3d& pose_b = sequence.frames()[b].world_from_camera;
  const cv::Mat light_a = renderer.Render(pose_a), light_b = renderer.Render(pose_b);
  Random random(3);
  Reprojection result;
  double last = 0;
  while (result.differences.size() < 1500) {
    const Eigen::Vector2d pixel(random.Uniform(2, sequence.camera().width - 3),
                                random.Uniform(2, sequence.camera().height - 3));
    const auto hit =
        CastRay(sequence.world(), pose_a.translation, pose_a.rotation * sequence.camera().Unproject(pixel));
    if (!hit) continue;
    const Eigen::Vector3d in_b = pose_b.Inverse() * hit->point_in_world;
    if (in_b.z() < 0.1) continue;
    const Eigen::Vector2d seen = sequence.camera().Project(in_b);
    if (!sequence.camera().Contains(seen + Eigen::Vector2d(2, 2)) ||
        !sequence.camera().Contains(seen - Eigen::Vector2d(2, 2)))
      continue;
    const auto back = CastRay(sequence.world(), pose_b.translation, hit->point_in_world - pose_b.translation);
    if (!back || back->quad != hit->quad) continue;  // hidden in b
    const double grey = Grey(light_a, pixel);
    result.differences.push_back(std::abs(grey - Grey(light_b, seen)));
    result.shifted.push_back(std::abs(grey - Grey(light_b, seen + Eigen::Vector2d(0.5, 0))));
    result.shuffled.push_back(std::abs(last - Grey(light_b, seen)));
    last = grey;
  }
  return result;
}

class ReprojectionTest : public testing::TestWithParam<const char*> {};

TEST_P(ReprojectionTest, FramesAgreeThroughTheTrueGeometry) {
  SequenceOptions options;
  options.scene = GetParam();
  options.width = 320;
  options.height = 240;
  options.texture_px = 512;
  const Result<SyntheticSequence> sequence = SyntheticSequence::Make(options);
  ASSERT_TRUE(sequence.ok());
  const Reprojection result = Reproject(*sequence, 40, 44);
  const double mean = cv::mean(result.differences)[0], shifted = cv::mean(result.shifted)[0];
  EXPECT_LT(Quantile(result.differences, 0.5), 4.0);
  EXPECT_LT(mean, 0.3 * cv::mean(result.shuffled)[0]);
  EXPECT_LT(mean, 0.85 * shifted);  // even half a pixel aside fits worse
}

INSTANTIATE_TEST_SUITE_P(Scenes, ReprojectionTest, testing::Values("town", "room", "wall"));

}  // namespace
}  // namespace portolan
