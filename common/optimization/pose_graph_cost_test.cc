#include "optimization/pose_graph_cost.h"

#include <gtest/gtest.h>

#include "geometry/geometry_test_utils.h"

namespace portolan {
namespace {

constexpr double kStep = 1e-6;

/// Two nodes, moved away from their references, and a measured edge some way off.
struct MeasuredPair {
  explicit MeasuredPair(uint64_t seed) : random(seed), i(RandomSim3(&random)), j(RandomSim3(&random)) {
    for (SimilarityUpdate* node : {&i, &j}) {
      for (int k = 0; k < 7; ++k) node->parameters()[k] = 0.3 * random.Gaussian();
      node->Prepare();
    }
    edge.j_from_i = RandomSim3(&random);
    edge.weight = 1.7;
    edge.length = 2.3;
  }
  Random random;
  SimilarityUpdate i, j;
  PoseGraph::Edge edge;
};

Vector7d Residual(const MeasuredPair& pair) {
  Vector7d residual;
  EXPECT_TRUE(EdgeCost(&pair.i, &pair.j, pair.edge).Evaluate(nullptr, residual.data(), nullptr));
  return residual;
}

TEST(SimilarityUpdateTest, StartsAtItsReference) {
  Random random(1);
  const Sim3d reference = RandomSim3(&random);
  const Sim3d pose = SimilarityUpdate(reference).CameraFromMap();
  const Eigen::Vector3d x = RandomVector(&random);
  EXPECT_THAT(pose * x, VectorNear(Eigen::Vector3d(reference * x), 1e-12));
}

TEST(SimilarityUpdateTest, PreparedPartsAreTheSimilarity) {
  MeasuredPair pair(2);
  const Eigen::Vector3d x = RandomVector(&pair.random);
  const Eigen::Vector3d by_parts = pair.i.scale() * (pair.i.rotation() * (x - pair.i.centre_in_map()));
  EXPECT_THAT(pair.i.CameraFromMap() * x, VectorNear(by_parts, 1e-12));
}

TEST(EdgeCostTest, IsTheErrorOfTheLoopThroughBothNodes) {
  const MeasuredPair pair(3);
  const Sim3d i = pair.i.CameraFromMap(), j = pair.j.CameraFromMap();
  const Sim3d e = pair.edge.j_from_i * i * j.Inverse();
  Vector7d expected;
  expected << e.translation / pair.edge.length, LogSO3(e.rotation), std::log(e.scale);
  EXPECT_LT((Residual(pair) - pair.edge.weight * expected).norm(), 1e-10);
  EXPECT_LT((EdgeResidual(i, j, pair.edge) - Residual(pair)).norm(), 1e-10);
}

TEST(EdgeCostTest, JacobiansAreTheNumericOnes) {
  for (uint64_t seed = 10; seed < 30; ++seed) {
    MeasuredPair pair(seed);
    Eigen::Matrix<double, 7, 7, Eigen::RowMajor> by_i, by_j;
    double* jacobians[] = {by_i.data(), by_j.data()};
    Vector7d residual;
    ASSERT_TRUE(EdgeCost(&pair.i, &pair.j, pair.edge).Evaluate(nullptr, residual.data(), jacobians));
    for (int k = 0; k < 14; ++k) {
      SimilarityUpdate& node = k < 7 ? pair.i : pair.j;
      double& parameter = node.parameters()[k % 7];
      const double value = parameter;
      parameter = value + kStep;
      node.Prepare();
      const Vector7d plus = Residual(pair);
      parameter = value - kStep;
      node.Prepare();
      const Vector7d minus = Residual(pair);
      parameter = value;
      node.Prepare();
      const Vector7d numeric = (plus - minus) / (2 * kStep);
      const Vector7d analytic = (k < 7 ? by_i : by_j).col(k % 7);
      EXPECT_LT((analytic - numeric).norm(), 1e-6 * (1 + numeric.norm())) << "seed " << seed << " parameter " << k;
    }
  }
}

TEST(EdgeCostTest, OneMissingJacobianIsNotWritten) {
  const MeasuredPair pair(4);
  Eigen::Matrix<double, 7, 7, Eigen::RowMajor> by_j;
  double* jacobians[] = {nullptr, by_j.data()};
  Vector7d residual;
  EXPECT_TRUE(EdgeCost(&pair.i, &pair.j, pair.edge).Evaluate(nullptr, residual.data(), jacobians));
  EXPECT_TRUE(by_j.allFinite());
}

}  // namespace
}  // namespace portolan
