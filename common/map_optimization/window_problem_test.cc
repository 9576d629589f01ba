#include "map_optimization/window_problem.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "testing/map_builder.h"
#include "testing/matchers.h"
#include "testing/synthetic_scene.h"

namespace portolan {
namespace {

using testing::IsEmpty;

class WindowProblemTest : public testing::Test {
 protected:
  void Build(const MapBuilderOptions& options) {
    SyntheticSceneOptions scene_options;
    scene_options.num_views = 6;
    scene_ = MakeSyntheticScene(scene_options);
    map_ = BuildMap(scene_, options);
    map_.TakeDelta();
    for (const SyntheticView& view : scene_.views) {
      (window_.fixed.size() < 2 ? window_.fixed : window_.free).push_back(view.data->id);
    }
    window_.points = map_.SortedPointIds();
  }
  SyntheticScene scene_;
  Map map_;
  BundleWindow window_;
};

TEST_F(WindowProblemTest, OfAnExactMapHasNoErrors) {
  Build(MapBuilderOptions());
  const WindowProblem made = MakeWindowProblem(map_, window_);
  ASSERT_EQ(made.sources.size(), made.problem.measurements.size());
  EXPECT_EQ(made.points.size(), map_.points().size());
  for (const auto& measurement : made.problem.measurements) {
    EXPECT_LT(NormalizedSquaredError(made.problem, measurement), 1e-6);
  }
  for (size_t k = 0; k < made.problem.poses.size(); ++k) EXPECT_EQ(made.problem.poses[k].fixed, k >= 4);
}

TEST_F(WindowProblemTest, LeavesOutPointsWithoutTwoObserversInside) {
  Build(MapBuilderOptions());
  window_.free.resize(1);
  window_.fixed.resize(1);
  const WindowProblem made = MakeWindowProblem(map_, window_);
  EXPECT_EQ(made.points.size(), static_cast<size_t>(map_.Covisibility(window_.free[0], window_.fixed[0])));
  EXPECT_EQ(made.problem.measurements.size(), 2 * made.points.size());
  for (const auto& m : made.problem.measurements) ASSERT_LT(m.point, made.problem.points_in_map.size());
}

TEST_F(WindowProblemTest, ASolutionGoesBackIntoTheMap) {
  MapBuilderOptions options;
  options.point_sigma = 0.02;
  Build(options);
  for (const KeyFrameId id : window_.free) {
    const Rigid3d pose = map_.keyframe(id).camera_from_map;
    map_.SetPose(
        id, Rigid3d(ExpSO3({0.002, -0.003, 0.001}) * pose.rotation, pose.translation + Eigen::Vector3d(0.01, 0, 0)));
  }
  WindowProblem problem = MakeWindowProblem(map_, window_);
  BundleOptions bundle;
  bundle.max_iterations = 30;
  bundle.function_tolerance = 1e-9;
  ASSERT_TRUE(AdjustBundle(&problem.problem, bundle, nullptr).converged_or_stopped);
  TakeSolution(window_, problem, &map_);
  EXPECT_THAT(map_, MapNear(scene_, MapTolerance{1e-4, 1e-3, 1e-2}));
}

TEST_F(WindowProblemTest, WhatDoesNotMoveIsNoChange) {
  Build(MapBuilderOptions());
  TakeSolution(window_, MakeWindowProblem(map_, window_), &map_);
  EXPECT_TRUE(map_.TakeDelta().IsEmpty());
}

TEST_F(WindowProblemTest, GrossErrorsGo) {
  Build(MapBuilderOptions());
  const MapPointId moved = window_.points[5];
  const size_t observers = map_.point(moved).observations.size();
  map_.SetPosition(moved, map_.point(moved).position_in_map + Eigen::Vector3f(1, 1, 0));
  const WindowProblem problem = MakeWindowProblem(map_, window_);
  EXPECT_EQ(RemoveOutliers(problem, 5.991, &map_), static_cast<int>(observers) - 1);
  EXPECT_EQ(map_.FindPoint(moved), nullptr) << "a point without two observations is none";
  EXPECT_THAT(ValidateMap(map_), IsEmpty());
}

}  // namespace
}  // namespace portolan
