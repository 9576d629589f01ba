#pragma once

#include <cmath>
#include <cstdint>

#include "geometry/geometry_test_utils.h"
#include "optimization/bundle_adjustment.h"

namespace portolan {

/// Cameras side by side looking at a cloud of points; the first `num_fixed` are fixed.
inline BundleProblem MakeProblem(int num_poses, int num_fixed, int num_points, double noise, uint64_t seed) {
  Random random(seed);
  BundleProblem problem;
  for (int i = 0; i < num_poses; ++i) {
    const Rigid3d turn(ExpSO3(RandomVector(&random, 0.03)), RandomVector(&random, 0.05));
    problem.poses.push_back(
        {turn * Rigid3d(Eigen::Quaterniond::Identity(), {-0.4 * i, 0, 0}), TestCamera(), i < num_fixed});
  }
  for (int j = 0; j < num_points; ++j) {
    const double x = random.Uniform(-2, 0.4 * num_poses + 2), y = random.Uniform(-2, 2), z = random.Uniform(4, 9);
    problem.points_in_map.emplace_back(x, y, z);
    for (int i = 0; i < num_poses; ++i) {
      const Eigen::Vector3d in_camera = problem.poses[i].camera_from_map * problem.points_in_map[j];
      if (in_camera.z() < 0.5 || !TestCamera().Contains(TestCamera().Project(in_camera))) continue;
      const double sigma = std::pow(1.2, static_cast<double>(random.Below(4)));
      problem.measurements.push_back({static_cast<uint32_t>(i), static_cast<uint32_t>(j),
                                      TestCamera().Project(in_camera) + RandomNoise(&random, noise * sigma), sigma});
    }
  }
  return problem;
}

/// Moves free poses and all points off their place.
inline BundleProblem Disturbed(BundleProblem problem, uint64_t seed) {
  Random random(seed);
  for (BundleProblem::Pose& pose : problem.poses) {
    if (!pose.fixed) pose.camera_from_map = RandomRigid(&random, 0.01, 0.03) * pose.camera_from_map;
  }
  for (Eigen::Vector3d& point : problem.points_in_map) point += RandomVector(&random, 0.05);
  return problem;
}

}  // namespace portolan
