#include "geometry/sim3_alignment.h"

#include <gtest/gtest.h>

#include <cmath>

#include "geometry/geometry_test_utils.h"

namespace portolan {
namespace {

std::vector<Eigen::Vector3d> RandomPoints(Random* random, int n) {
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < n; ++i) points.push_back(RandomVector(random, 5));
  return points;
}

std::vector<Eigen::Vector3d> Transformed(const Sim3d& b_from_a, const std::vector<Eigen::Vector3d>& in_a) {
  std::vector<Eigen::Vector3d> in_b;
  for (const Eigen::Vector3d& point : in_a) in_b.push_back(b_from_a * point);
  return in_b;
}

void ExpectNear(const Sim3d& actual, const Sim3d& expected, double tolerance) {
  EXPECT_NEAR(actual.scale, expected.scale, tolerance);
  EXPECT_LT(actual.rotation.angularDistance(expected.rotation), tolerance);
  EXPECT_THAT(actual.translation, VectorNear(expected.translation, tolerance));
}

TEST(AlignPointsTest, ExactPointsGiveTheSimilarity) {
  Random random(1);
  for (const int n : {3, 4, 100}) {
    const Sim3d b_from_a = RandomSim3(&random);
    const auto in_a = RandomPoints(&random, n);
    const auto aligned = AlignPoints(in_a, Transformed(b_from_a, in_a));
    ASSERT_TRUE(aligned.ok());
    ExpectNear(*aligned, b_from_a, 1e-6);
  }
}

TEST(AlignPointsTest, PlanarPointsGiveARotationAndNoReflection) {
  Random random(2);
  auto in_a = RandomPoints(&random, 20);
  for (Eigen::Vector3d& point : in_a) point.z() = 0;
  const Sim3d b_from_a = RandomSim3(&random);
  const auto aligned = AlignPoints(in_a, Transformed(b_from_a, in_a));
  ASSERT_TRUE(aligned.ok());
  ExpectNear(*aligned, b_from_a, 1e-6);
}

TEST(AlignPointsTest, MirroredPointsStillGiveARotation) {
  Random random(3);
  const auto in_a = RandomPoints(&random, 30);
  auto in_b = in_a;
  for (Eigen::Vector3d& point : in_b) point.z() *= -1;
  const auto aligned = AlignPoints(in_a, in_b);
  ASSERT_TRUE(aligned.ok());
  EXPECT_NEAR(aligned->rotation.toRotationMatrix().determinant(), 1, 1e-9);
}

TEST(AlignPointsTest, FixedScaleStaysOne) {
  Random random(4);
  const Rigid3d rigid = RandomRigid(&random);
  const auto in_a = RandomPoints(&random, 10);
  auto in_b = Transformed(Sim3d(rigid), in_a);
  const auto aligned = AlignPoints(in_a, in_b, true);
  ASSERT_TRUE(aligned.ok());
  ExpectNear(*aligned, Sim3d(rigid), 1e-6);
  for (Eigen::Vector3d& point : in_b) point *= 2;
  const auto still_rigid = AlignPoints(in_a, in_b, true);
  ASSERT_TRUE(still_rigid.ok());
  EXPECT_EQ(still_rigid->scale, 1);
}

TEST(AlignPointsTest, NoSmallChangeReducesTheError) {
  Random random(5);
  const auto in_a = RandomPoints(&random, 50);
  auto in_b = Transformed(RandomSim3(&random), in_a);
  for (Eigen::Vector3d& point : in_b) point += RandomVector(&random, 0.3);
  const auto aligned = AlignPoints(in_a, in_b);
  ASSERT_TRUE(aligned.ok());
  const auto error = [&](const Sim3d& b_from_a) {
    double sum = 0;
    for (size_t i = 0; i < in_a.size(); ++i) sum += (in_b[i] - b_from_a * in_a[i]).squaredNorm();
    return sum;
  };
  const double least = error(*aligned);
  for (int k = 0; k < 7; ++k) {
    for (const double step : {-1e-3, 1e-3}) {
      Sim3d moved = *aligned;
      if (k < 3) moved.translation[k] += step;
      if (k >= 3 && k < 6) moved.rotation = ExpSO3(step * Eigen::Vector3d::Unit(k - 3)) * moved.rotation;
      if (k == 6) moved.scale += step;
      EXPECT_GT(error(moved), least) << "parameter " << k;
    }
  }
}

TEST(AlignPointsTest, TooFewCollinearAndNonFinitePointsAreRefused) {
  Random random(6);
  const auto two = RandomPoints(&random, 2);
  EXPECT_THAT(AlignPoints(two, two).error().message, testing::HasSubstr("at least 3"));
  std::vector<Eigen::Vector3d> line;
  for (int i = 0; i < 10; ++i) line.emplace_back(i, 2 * i, -i);
  const auto spread = RandomPoints(&random, 10);
  EXPECT_THAT(AlignPoints(line, spread).error().message, testing::HasSubstr("line"));
  EXPECT_THAT(AlignPoints(spread, line).error().message, testing::HasSubstr("line"));
  auto spoilt = spread;
  spoilt[4].y() = std::nan("");
  EXPECT_THAT(AlignPoints(spread, spoilt).error().message, testing::HasSubstr("finite"));
  EXPECT_THROW((void)AlignPoints(spread, two), CheckFailure);
}

}  // namespace
}  // namespace portolan
