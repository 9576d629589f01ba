#include "dataset/trajectory_evaluation.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "base/random.h"
#include "dataset/evaluation_report.h"
#include "dataset/transformed_trajectory.h"

namespace portolan {
namespace {

using testing::HasSubstr;

/// A rising spiral, 10 poses a second, that turns with its path.
Trajectory Spiral(int size) {
  Trajectory trajectory;
  for (int i = 0; i < size; ++i) {
    const double t = 0.1 * i;
    const Eigen::Vector3d position(5 * std::cos(0.3 * t), 5 * std::sin(0.3 * t), 0.2 * t);
    trajectory.push_back(
        {Timestamp{i * 100000000LL}, Rigid3d(ExpSO3({0.1 * std::sin(t), 0.2, 0.3 * t - 3}), position), 0});
  }
  return trajectory;
}

Sim3d SomeSim3() {
  return Sim3d(0.3, ExpSO3({0.5, -1, 2}), {7, -3, 1});
}

void AddNoise(Trajectory* trajectory, double sigma) {
  Random random(4);
  for (TrajectoryPose& pose : *trajectory) {
    for (int k = 0; k < 3; ++k) pose.world_from_camera.translation[k] += sigma * random.Gaussian();
  }
}

TEST(TrajectoryEvaluationTest, ASimilarTrajectoryHasNoError) {
  const Trajectory truth = Spiral(200);
  const auto evaluation = EvaluateTrajectory(truth, Transformed(truth, SomeSim3()), {});
  ASSERT_TRUE(evaluation) << evaluation.error().message;
  ASSERT_TRUE(evaluation->joined.truth_from_map);
  EXPECT_NEAR(evaluation->joined.truth_from_map->scale, 1 / 0.3, 1e-9);
  EXPECT_LT(evaluation->joined.ate.max, 1e-9);
  EXPECT_LT(evaluation->rpe_translation.max, 1e-9);
  EXPECT_LT(evaluation->rpe_rotation_deg.max, 1e-5);
  EXPECT_EQ(evaluation->rpe_translation.count, 190u)
      << "every pose but those of the last second has one a second later";
  EXPECT_EQ(evaluation->Coverage(), 1);
}

TEST(TrajectoryEvaluationTest, AFixedScaleShowsAScaleError) {
  const Trajectory truth = Spiral(200);
  EvaluationOptions options;
  options.fix_scale = true;
  const Sim3d larger(1.1, Eigen::Quaterniond::Identity(), Eigen::Vector3d::Zero());
  const auto evaluation = EvaluateTrajectory(truth, Transformed(truth, larger), options);
  ASSERT_TRUE(evaluation);
  EXPECT_DOUBLE_EQ(evaluation->joined.truth_from_map->scale, 1);
  EXPECT_GT(evaluation->joined.ate.rmse, 0.3);
  const auto moved = EvaluateTrajectory(truth, Transformed(truth, Sim3d(1, ExpSO3({1, 2, 0}), {1, 2, 3})), options);
  EXPECT_LT(moved->joined.ate.max, 1e-9);
}

/// ATE of independent noise is sigma * sqrt(3); its relative error falls with the root of the number of values, and the
/// fit takes 7 of them.
TEST(TrajectoryEvaluationTest, AteMeasuresTheNoise) {
  const Trajectory truth = Spiral(1000);
  Trajectory estimate = truth;
  constexpr double kSigma = 0.05;
  AddNoise(&estimate, kSigma);
  const auto evaluation = EvaluateTrajectory(truth, Transformed(estimate, SomeSim3()), {});
  ASSERT_TRUE(evaluation);
  EXPECT_NEAR(evaluation->joined.ate.rmse, kSigma * std::sqrt(3.0), 5 * kSigma / std::sqrt(2.0 * 1000));
  EXPECT_NEAR(evaluation->rpe_translation.rmse, kSigma * std::sqrt(6.0), 10 * kSigma / std::sqrt(2.0 * 1000))
      << "two noisy ends";
}

TEST(TrajectoryEvaluationTest, EachMapIsAlignedByItself) {
  const Trajectory truth = Spiral(200);
  Trajectory estimate = Transformed(Trajectory(truth.begin(), truth.begin() + 80), SomeSim3(), 2);
  const Trajectory second =
      Transformed(Trajectory(truth.begin() + 120, truth.end()), Sim3d(4, ExpSO3({2, 0, 1}), {0, 0, 9}), 5);
  estimate.insert(estimate.end(), second.begin(), second.end());
  const auto evaluation = EvaluateTrajectory(truth, estimate, {});
  ASSERT_TRUE(evaluation) << evaluation.error().message;
  ASSERT_EQ(evaluation->maps.size(), 2u);
  EXPECT_EQ(evaluation->maps[0].map, 2);
  EXPECT_EQ(evaluation->maps[1].map, 5);
  EXPECT_NEAR(evaluation->maps[0].truth_from_map->scale, 1 / 0.3, 1e-9);
  EXPECT_NEAR(evaluation->maps[1].truth_from_map->scale, 1 / 4.0, 1e-9);
  EXPECT_LT(evaluation->maps_combined.max, 1e-9);
  EXPECT_EQ(evaluation->maps_combined.count, 160u);
  EXPECT_GT(evaluation->joined.ate.rmse, 1) << "two frames do not align as one";
  EXPECT_LT(evaluation->rpe_translation.max, 1e-9) << "only within maps, each at its own scale";
  EXPECT_EQ(evaluation->rpe_translation.count, 70u + 70u);
  EXPECT_NEAR(evaluation->Coverage(), 0.8, 1e-12);
}

TEST(TrajectoryEvaluationTest, AMapThatCannotBeAlignedSaysSo) {
  const Trajectory truth = Spiral(50);
  Trajectory estimate = Transformed(Trajectory(truth.begin(), truth.begin() + 40), SomeSim3(), 0);
  const Trajectory two_poses = Transformed(Trajectory(truth.begin() + 45, truth.begin() + 47), SomeSim3(), 1);
  estimate.insert(estimate.end(), two_poses.begin(), two_poses.end());
  const auto evaluation = EvaluateTrajectory(truth, estimate, {});
  ASSERT_TRUE(evaluation);
  EXPECT_FALSE(evaluation->maps[1].truth_from_map);
  EXPECT_FALSE(evaluation->maps[1].failure.empty());
  EXPECT_EQ(evaluation->maps_combined.count, 40u);
  EXPECT_THAT(FormatEvaluation(*evaluation, "1s"), HasSubstr("not aligned: " + evaluation->maps[1].failure));
}

TEST(TrajectoryEvaluationTest, RotationErrorIsMeasuredInDegrees) {
  const Trajectory truth = Spiral(100);
  Trajectory estimate = truth;
  for (size_t i = 0; i < estimate.size(); ++i) {  // drifts by 0.2 degrees a frame about the camera's own y axis
    Rigid3d& pose = estimate[i].world_from_camera;
    pose.rotation = ExpSO3({0, 0, 0.2 * static_cast<double>(i) * M_PI / 180}) * pose.rotation;
  }
  EvaluationOptions options;
  options.rpe_frames = 5;
  const auto evaluation = EvaluateTrajectory(truth, estimate, options);
  ASSERT_TRUE(evaluation);
  EXPECT_NEAR(evaluation->rpe_rotation_deg.median, 1, 1e-6);
  EXPECT_NEAR(evaluation->rpe_rotation_deg.max, 1, 1e-6);
  EXPECT_EQ(evaluation->rpe_rotation_deg.count, 95u);
}

TEST(TrajectoryEvaluationTest, ASpanLeavesTheRestOut) {
  const Trajectory truth = Spiral(100);
  Trajectory estimate = truth;
  for (size_t i = 50; i < 100; ++i) estimate[i].world_from_camera.translation += Eigen::Vector3d(0, 0, 100);
  EvaluationOptions options;
  options.from = truth[10].stamp;
  options.to = truth[49].stamp;
  const auto evaluation = EvaluateTrajectory(truth, estimate, options);
  ASSERT_TRUE(evaluation);
  EXPECT_EQ(evaluation->joined.pairs.size(), 40u);
  EXPECT_EQ(evaluation->num_frames, 40u);
  EXPECT_LT(evaluation->joined.ate.max, 1e-9);
}

TEST(TrajectoryEvaluationTest, CoverageCountsTheCamerasFrames) {
  const Trajectory truth = Spiral(100);  // 10 Hz
  EvaluationOptions options;
  for (int i = 0; i < 25; ++i) options.frames.push_back(truth[4 * i].stamp);
  EXPECT_EQ(EvaluateTrajectory(truth, truth, options)->Coverage(), 1)
      << "an estimate of a higher rate covers no more than all";
  const Trajectory half(truth.begin(), truth.begin() + 40);
  EXPECT_NEAR(EvaluateTrajectory(truth, half, options)->Coverage(), 0.4, 1e-12);
  options.to = truth[79].stamp;
  EXPECT_NEAR(EvaluateTrajectory(truth, half, options)->Coverage(), 0.5, 1e-12);
  options.num_frames = 50;
  EXPECT_NEAR(EvaluateTrajectory(truth, half, options)->Coverage(), 0.8, 1e-12) << "40 poses of 50 frames";
}

TEST(TrajectoryEvaluationTest, NoCommonTimesNameBothSpans) {
  Trajectory late = Spiral(5);
  for (TrajectoryPose& pose : late) pose.stamp.ns += 1000000000000;
  const auto evaluation = EvaluateTrajectory(Spiral(5), late, {});
  ASSERT_FALSE(evaluation);
  EXPECT_THAT(
      evaluation.error().message,
      HasSubstr("ground truth has 5 poses from 0.000000000 s to 0.400000000 s, the estimate 5 poses from 1000.0"));
  EXPECT_THAT(EvaluateTrajectory(Spiral(5), {}, {}).error().message, HasSubstr("the estimate no poses"));
  EXPECT_FALSE(EvaluateTrajectory({}, Spiral(5), {}));
}

TEST(TrajectoryEvaluationTest, AssociatesNearestTimesOnceEach) {
  const auto at = [](std::vector<int64_t> milliseconds) {
    Trajectory trajectory;
    for (const int64_t ms : milliseconds) trajectory.push_back({Timestamp{ms * 1000000}, Rigid3d(), 0});
    return trajectory;
  };
  const auto pairs = AssociateByTime(at({0, 100, 200, 300}), at({-60, 8, 96, 101, 149, 251, 1000}), 0.05);
  ASSERT_EQ(pairs.size(), 3u);
  EXPECT_EQ(pairs[0].truth, 0u);
  EXPECT_EQ(pairs[0].estimate, 1u) << "8 ms, not -60 ms";
  EXPECT_EQ(pairs[1].truth, 1u);
  EXPECT_EQ(pairs[1].estimate, 3u) << "101 ms is nearer to 100 ms than 96 and 149";
  EXPECT_EQ(pairs[2].truth, 3u) << "251 ms is nearer to 300 than to 200";
  EXPECT_TRUE(AssociateByTime({}, at({0}), 1).empty());
}

TEST(TrajectoryEvaluationTest, SelectsOnePoseAFrame) {
  const Trajectory truth = Spiral(100);
  std::vector<Timestamp> frames;
  for (int i = 0; i < 20; ++i) frames.push_back(Timestamp{i * 200000000LL + 10});
  frames.push_back(Timestamp{50000000000});  // long after the last pose
  const Trajectory selected = SelectFrames(truth, frames, 0.05);
  ASSERT_EQ(selected.size(), 20u);
  EXPECT_EQ(selected[3].stamp, truth[6].stamp);
  EXPECT_NEAR(HalfMedianInterval(truth), 0.05, 2e-6);
  EXPECT_EQ(HalfMedianInterval({}), 0);
}

TEST(TrajectoryEvaluationTest, SummarisesErrors) {
  const ErrorStatistics statistics = Summarize({1, 2, 3, 6});
  EXPECT_EQ(statistics.count, 4u);
  EXPECT_DOUBLE_EQ(statistics.mean, 3);
  EXPECT_DOUBLE_EQ(statistics.median, 2.5);
  EXPECT_DOUBLE_EQ(statistics.rmse, std::sqrt(12.5));
  EXPECT_DOUBLE_EQ(statistics.std, std::sqrt(3.5));
  EXPECT_DOUBLE_EQ(statistics.max, 6);
  EXPECT_EQ(Summarize({}).rmse, 0);
}

TEST(TrajectoryEvaluationTest, JsonHoldsTheFigures) {
  const Trajectory truth = Spiral(30);
  const auto evaluation = EvaluateTrajectory(truth, Transformed(truth, SomeSim3()), {});
  const auto json = nlohmann::json::parse(EvaluationToJson(*evaluation));
  EXPECT_EQ(json["frames"], 30);
  EXPECT_EQ(json["coverage"], 1.0);
  EXPECT_EQ(json["joined"]["matched"], 30);
  EXPECT_NEAR(json["joined"]["scale"].get<double>(), 1 / 0.3, 1e-9);
  EXPECT_LT(json["joined"]["ate"]["rmse"].get<double>(), 1e-9);
  EXPECT_EQ(json["maps"].size(), 1u);
}

}  // namespace
}  // namespace portolan
