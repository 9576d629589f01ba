#include "tracking/initializer.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "tracking/synthetic_frame.h"

namespace portolan {
namespace {

Eigen::Quaterniond Turn(const SyntheticScene& scene, size_t from, size_t to) {
  return scene.views[to].camera_from_world.rotation * scene.views[from].camera_from_world.rotation.conjugate();
}

/// Median of Eq. (8) over the true matches of view 0 and another.
double TrueBaseline(const SyntheticScene& scene, size_t view) {
  const PinholeCamera& camera = scene.options.camera;
  const Eigen::Quaterniond first_from_current = Turn(scene, 0, view).conjugate();
  std::vector<double> motions;
  for (const auto& [a, b] : TrueMatches(scene.views[0], scene.views[view])) {
    const Eigen::Vector2d second = scene.views[view].data->features.pixels_px[b].cast<double>();
    const Eigen::Vector2d first = scene.views[0].data->features.pixels_px[a].cast<double>();
    motions.push_back((camera.Project(first_from_current * camera.Unproject(second)) - first).norm());
  }
  std::nth_element(motions.begin(), motions.begin() + static_cast<ptrdiff_t>(motions.size() / 2), motions.end());
  return motions[motions.size() / 2];
}

SyntheticSceneOptions Sideways() {
  SyntheticSceneOptions options;
  options.num_views = 30;
  options.travel = 1.5;
  options.pixel_sigma_px = 0.3;
  return options;
}

TEST(Initializer, ChoosesThePairAtTwentyPixels) {
  const SyntheticScene scene = MakeSyntheticScene(Sideways());
  Initializer initializer{InitializerOptions()};
  EXPECT_FALSE(initializer.Offer(FrameOfView(scene, 0), Eigen::Quaterniond::Identity()));
  for (size_t view = 1; view < scene.views.size(); ++view) {
    const auto pair = initializer.Offer(FrameOfView(scene, view), Turn(scene, view - 1, view));
    const double truth = TrueBaseline(scene, view);
    EXPECT_NEAR(initializer.baseline_px(), truth, 1.0) << "view " << view;
    if (!pair) {
      ASSERT_LT(truth, 21) << "view " << view;
      continue;
    }
    EXPECT_GT(truth, 19);
    EXPECT_EQ(pair->first.number, 0u);
    EXPECT_EQ(pair->second.number, view);
    EXPECT_LT(pair->second_from_first.angularDistance(Turn(scene, 0, view)), 1e-6);
    const auto true_matches = TrueMatches(scene.views[0], scene.views[view]);
    EXPECT_GT(pair->matches.size(), 0.8 * static_cast<double>(true_matches.size()));
    size_t right = 0;
    for (const auto& match : pair->matches)
      right += std::count(true_matches.begin(), true_matches.end(), match) > 0 ? 1 : 0;
    EXPECT_GT(right, 0.95 * static_cast<double>(pair->matches.size()));
    return;
  }
  FAIL() << "no pair";
}

TEST(Initializer, PureRotationNeverGivesAPair) {
  SyntheticSceneOptions options = Sideways();
  options.motion = CameraMotion::kPureRotation;
  const SyntheticScene scene = MakeSyntheticScene(options);  // 0.3 rad: 150 pixels
  Initializer initializer{InitializerOptions()};
  for (size_t view = 0; view < scene.views.size(); ++view) {
    const auto turn = view > 0 ? Turn(scene, view - 1, view) : Eigen::Quaterniond::Identity();
    EXPECT_FALSE(initializer.Offer(FrameOfView(scene, view), turn)) << "view " << view;
    EXPECT_LT(initializer.baseline_px(), 3);
  }
}

TEST(Initializer, FewMatchesSetTheFirstFrameAnew) {
  const SyntheticScene scene = MakeSyntheticScene(Sideways());
  SyntheticSceneOptions elsewhere_options = Sideways();
  elsewhere_options.seed = 2;
  const SyntheticScene elsewhere = MakeSyntheticScene(elsewhere_options);
  Initializer initializer{InitializerOptions()};
  const auto none = Eigen::Quaterniond::Identity();
  EXPECT_FALSE(initializer.Offer(FrameOfView(scene, 0), none));
  EXPECT_FALSE(initializer.Offer(FrameOfView(elsewhere, 0), none));  // shows something else: the new first
  EXPECT_TRUE(initializer.has_first());
  EXPECT_EQ(initializer.num_matches(), 0u);
  EXPECT_FALSE(initializer.Offer(FrameOfView(elsewhere, 1), Turn(elsewhere, 0, 1)));
  EXPECT_GT(initializer.num_matches(), 100u);
}

TEST(Initializer, AFrameWithFewFeaturesIsNoFirst) {
  SyntheticSceneOptions options = Sideways();
  options.num_landmarks = 100;
  const SyntheticScene poor = MakeSyntheticScene(options);
  Initializer initializer{InitializerOptions()};
  EXPECT_FALSE(initializer.Offer(FrameOfView(poor, 0), Eigen::Quaterniond::Identity()));
  EXPECT_FALSE(initializer.has_first());
}

TEST(Initializer, WaitsNoLongerThanItsLimit) {
  SyntheticSceneOptions options = Sideways();
  options.travel = 0;  // stands still
  const SyntheticScene scene = MakeSyntheticScene(options);
  InitializerOptions limits;
  limits.max_frames = 5;
  Initializer initializer(limits);
  const auto none = Eigen::Quaterniond::Identity();
  for (size_t view = 0; view <= 5; ++view) {
    EXPECT_FALSE(initializer.Offer(FrameOfView(scene, view), none));
  }
  EXPECT_GT(initializer.num_matches(), 100u);
  EXPECT_FALSE(initializer.Offer(FrameOfView(scene, 6), none));  // the sixth after the first: the new first
  EXPECT_EQ(initializer.num_matches(), 0u);
  initializer.Reset();
  EXPECT_FALSE(initializer.has_first());
}

TEST(Initializer, BaselineShrinksWithAShortFocalLength) {
  SyntheticSceneOptions options = Sideways();
  options.camera = PinholeCamera{250, 250, 319.5, 239.5, 640, 480};
  const SyntheticScene scene = MakeSyntheticScene(options);
  Initializer initializer{InitializerOptions()};
  for (size_t view = 0; view < scene.views.size(); ++view) {
    const auto turn = view > 0 ? Turn(scene, view - 1, view) : Eigen::Quaterniond::Identity();
    const auto pair = initializer.Offer(FrameOfView(scene, view), turn);
    if (!pair) continue;
    EXPECT_GE(pair->baseline_px, 10);  // half the focal length, half the pixels
    EXPECT_LT(pair->baseline_px, 13);
    return;
  }
  FAIL() << "no pair";
}

TEST(Initializer, BaselineShrinksWithANarrowView) {
  const InitializerOptions options;
  EXPECT_EQ(RequiredBaseline(options, {500, 500, 319.5, 239.5, 640, 480}), 20);  // half the diagonal: 0.8
  EXPECT_EQ(RequiredBaseline(options, {718, 718, 620, 188, 1241, 376}), 20);     // 0.9
  EXPECT_NEAR(RequiredBaseline(options, {1000, 1000, 319.5, 239.5, 640, 480}), 20 * 0.4 / 0.6, 1e-12);
  EXPECT_NEAR(RequiredBaseline(options, {250, 250, 79.5, 59.5, 160, 120}), 20 * 0.5,
              1e-12);  // the focal length's, less
}

}  // namespace
}  // namespace portolan
