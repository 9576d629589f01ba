#include "optimization/pose_graph.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>

#include "base/check.h"
#include "geometry/geometry_test_utils.h"

namespace portolan {
namespace {

/// Cameras evenly around a circle of the given radius, looking along it; scale 1.
std::vector<Sim3d> MakeLap(int count, double radius) {
  std::vector<Sim3d> lap;
  for (int k = 0; k < count; ++k) {
    const double angle = 2 * M_PI * k / count;
    const Eigen::Quaterniond rotation = ExpSO3(Eigen::Vector3d(0, angle, 0));
    const Eigen::Vector3d centre(radius * std::cos(angle), 0.1 * std::sin(3 * angle), radius * std::sin(angle));
    lap.emplace_back(1.0, rotation, -(rotation * centre));
  }
  return lap;
}

Sim3d Relative(const std::vector<Sim3d>& poses, uint32_t i, uint32_t j) {
  return poses[j] * poses[i].Inverse();
}

/// A chain with edges to the next `reach` nodes, measured exactly; the first node is fixed.
PoseGraph MakeChain(const std::vector<Sim3d>& poses, uint32_t reach) {
  PoseGraph graph;
  for (const Sim3d& pose : poses) graph.nodes.push_back({pose, graph.nodes.empty()});
  for (uint32_t i = 0; i < poses.size(); ++i) {
    for (uint32_t j = i + 1; j < poses.size() && j <= i + reach; ++j) {
      graph.edges.push_back({i, j, Relative(poses, i, j)});
    }
  }
  return graph;
}

PoseGraphOptions Thorough() {
  PoseGraphOptions options;
  options.max_iterations = 100;
  options.function_tolerance = 1e-14;
  return options;
}

double WorstResidual(const PoseGraph& graph) {
  double worst = 0;
  for (const PoseGraph::Edge& e : graph.edges) {
    const double norm = EdgeResidual(graph.nodes[e.i].camera_from_map, graph.nodes[e.j].camera_from_map, e).norm();
    worst = std::max(worst, norm);
  }
  return worst;
}

double WorstCentreError(const PoseGraph& graph, const std::vector<Sim3d>& truth) {
  double worst = 0;
  for (size_t k = 0; k < truth.size(); ++k) {
    const Eigen::Vector3d centre = graph.nodes[k].camera_from_map.Inverse().translation;
    worst = std::max(worst, (centre - truth[k].Inverse().translation).norm());
  }
  return worst;
}

void ExpectUnchanged(const PoseGraph& graph, const PoseGraph& before) {
  for (size_t k = 0; k < before.nodes.size(); ++k) {
    const Sim3d& a = graph.nodes[k].camera_from_map;
    const Sim3d& b = before.nodes[k].camera_from_map;
    EXPECT_EQ(a.rotation.coeffs(), b.rotation.coeffs());
    EXPECT_EQ(a.translation, b.translation);
    EXPECT_EQ(a.scale, b.scale);
  }
}

TEST(PoseGraphTest, AnExactGraphStays) {
  const auto truth = MakeLap(30, 10);
  PoseGraph graph = MakeChain(truth, 3);
  const PoseGraphSummary summary = OptimizePoseGraph(&graph, Thorough(), nullptr);
  EXPECT_TRUE(summary.converged_or_stopped);
  EXPECT_LT(WorstCentreError(graph, truth), 1e-9);
}

TEST(PoseGraphTest, APerturbedConsistentGraphConvergesToTheTruth) {
  Random random(1);
  std::vector<Sim3d> truth = MakeLap(40, 10);
  for (size_t k = 1; k < truth.size(); ++k)
    truth[k] = Sim3d(random.Uniform(0.7, 1.4), {1, 0, 0, 0}, {0, 0, 0}) * truth[k];
  PoseGraph graph = MakeChain(truth, 3);
  graph.edges.push_back({39, 0, Relative(truth, 39, 0)});
  for (size_t k = 1; k < truth.size(); ++k) {
    const Rigid3d shift = RandomRigid(&random, 0.2, 1.0);
    graph.nodes[k].camera_from_map =
        Sim3d(random.Uniform(0.7, 1.4), shift.rotation, shift.translation) * graph.nodes[k].camera_from_map;
  }
  const PoseGraphSummary summary = OptimizePoseGraph(&graph, Thorough(), nullptr);
  ASSERT_TRUE(summary.converged_or_stopped);
  EXPECT_LT(WorstCentreError(graph, truth), 1e-6);
  EXPECT_LT(WorstResidual(graph), 1e-6);
  for (size_t k = 0; k < truth.size(); ++k) EXPECT_NEAR(graph.nodes[k].camera_from_map.scale, truth[k].scale, 1e-6);
}

/// A lap as visual odometry sees it: every step is a little off in scale, rotation and translation.
std::vector<Sim3d> DriftingLap(const std::vector<Sim3d>& truth, double scale_step, const Eigen::Vector3d& turn_step) {
  std::vector<Sim3d> drifted = {truth[0]};
  double scale = 1;
  for (uint32_t k = 1; k < truth.size(); ++k) {
    scale *= scale_step;
    Sim3d step = Relative(truth, k - 1, k);
    step.rotation = ExpSO3(turn_step) * step.rotation;
    step.translation *= scale;
    drifted.push_back(step * drifted.back());
  }
  return drifted;
}

TEST(PoseGraphTest, ALoopSpreadsItsDriftOverTheChain) {
  const auto truth = MakeLap(100, 20);
  const double scale_step = 0.995;  // 40 % over the lap
  PoseGraph graph = MakeChain(DriftingLap(truth, scale_step, {0.0005, 0.001, 0}), 1);
  const double before = WorstCentreError(graph, truth);
  Sim3d loop = Relative(truth, 99, 0);  // in the units of node 0, from those of node 99
  loop.scale = std::pow(scale_step, -99);
  graph.edges.push_back({99, 0, loop});
  ASSERT_TRUE(OptimizePoseGraph(&graph, Thorough(), nullptr).converged_or_stopped);
  EXPECT_LT(WorstCentreError(graph, truth), 0.1 * before);
  double previous = graph.nodes[0].camera_from_map.scale;
  for (size_t k = 1; k < truth.size(); ++k) {  // every step takes its share of the scale, none more than twice that
    const double step = graph.nodes[k].camera_from_map.scale / previous;
    EXPECT_GT(step, scale_step * scale_step) << "node " << k;
    EXPECT_LT(step, 1.0) << "node " << k;
    previous = graph.nodes[k].camera_from_map.scale;
  }
}

TEST(PoseGraphTest, ClosesALoopThatTurnedByHalf) {
  const auto truth = MakeLap(200, 40);
  PoseGraph graph = MakeChain(DriftingLap(truth, 0.999, {0, M_PI / 200, 0}), 3);
  const double before = WorstCentreError(graph, truth);
  Sim3d loop = Relative(truth, 199, 0);
  loop.scale = std::pow(0.999, -199);
  graph.edges.push_back({199, 0, loop});
  const PoseGraphSummary summary = OptimizePoseGraph(&graph, PoseGraphOptions(), nullptr);
  ASSERT_TRUE(summary.converged_or_stopped);
  EXPECT_LT(WorstResidual(graph), 0.3);  // steps are 1.3 long, and each turned by 0.016 more than it should be
  EXPECT_LT(WorstCentreError(graph, truth), 0.3 * before);
}

TEST(PoseGraphTest, FixedScalesStay) {
  const auto truth = MakeLap(50, 20);
  PoseGraph graph = MakeChain(DriftingLap(truth, 1.0, {0, 0.002, 0}), 2);
  graph.edges.push_back({49, 0, Relative(truth, 49, 0)});
  const double before = WorstCentreError(graph, truth);
  PoseGraphOptions options = Thorough();
  options.fix_scales = true;
  ASSERT_TRUE(OptimizePoseGraph(&graph, options, nullptr).converged_or_stopped);
  for (const PoseGraph::Node& node : graph.nodes) EXPECT_EQ(node.camera_from_map.scale, 1.0);
  EXPECT_LT(WorstCentreError(graph, truth), 0.2 * before);
}

TEST(PoseGraphTest, FixedNodesDoNotMove) {
  const auto truth = MakeLap(20, 10);
  PoseGraph graph = MakeChain(truth, 1);
  graph.nodes[7].camera_from_map.translation.x() += 1;
  graph.nodes[7].fixed = true;
  const PoseGraph before = graph;
  ASSERT_TRUE(OptimizePoseGraph(&graph, Thorough(), nullptr).converged_or_stopped);
  EXPECT_EQ(graph.nodes[7].camera_from_map.translation, before.nodes[7].camera_from_map.translation);
  EXPECT_NE(graph.nodes[6].camera_from_map.translation, before.nodes[6].camera_from_map.translation);
}

TEST(PoseGraphTest, APartThatNothingHoldsIsSolvedNearItsPlace) {
  const auto truth = MakeLap(20, 10);
  PoseGraph graph = MakeChain(truth, 2);
  graph.nodes[0].fixed = false;
  graph.nodes[10].camera_from_map.translation.x() += 1;
  ASSERT_TRUE(OptimizePoseGraph(&graph, Thorough(), nullptr).converged_or_stopped);
  EXPECT_LT(WorstResidual(graph), 1e-5);
  EXPECT_LT(WorstCentreError(graph, truth), 1.0);
}

TEST(PoseGraphTest, ARobustLossLeavesAWrongEdgeAlone) {
  const auto truth = MakeLap(50, 20);
  PoseGraph plain = MakeChain(truth, 3);
  plain.edges.push_back({10, 40, Sim3d()});
  PoseGraph robust = plain;
  PoseGraphOptions options = Thorough();
  ASSERT_TRUE(OptimizePoseGraph(&plain, options, nullptr).converged_or_stopped);
  options.loss_width = 1e-3;
  ASSERT_TRUE(OptimizePoseGraph(&robust, options, nullptr).converged_or_stopped);
  EXPECT_GT(WorstCentreError(plain, truth), 1.0);
  EXPECT_LT(WorstCentreError(robust, truth), 0.1);
}

TEST(PoseGraphTest, StopInterrupts) {
  const auto truth = MakeLap(60, 20);
  PoseGraph graph = MakeChain(DriftingLap(truth, 0.99, {0, 0.01, 0}), 2);
  graph.edges.push_back({59, 0, Relative(truth, 59, 0)});
  const std::atomic<bool> stop{true};
  const PoseGraphSummary summary = OptimizePoseGraph(&graph, Thorough(), &stop);
  EXPECT_TRUE(summary.interrupted);
  EXPECT_TRUE(summary.converged_or_stopped);
  EXPECT_LE(summary.iterations, 1);
}

TEST(PoseGraphTest, RefusesWhatIsNotFinite) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const std::vector<std::function<void(PoseGraph*)>> spoilers = {
      [&](PoseGraph* g) { g->nodes[2].camera_from_map.translation.x() = nan; },
      [&](PoseGraph* g) { g->nodes[2].camera_from_map.scale = 0; },
      [&](PoseGraph* g) { g->edges[2].j_from_i.rotation.w() = nan; },
      [&](PoseGraph* g) { g->edges[2].j_from_i.scale = -1; },
      [&](PoseGraph* g) { g->edges[2].weight = nan; },
      [&](PoseGraph* g) { g->edges[2].length = 0; },
      [&](PoseGraph* g) { g->edges.clear(); },
  };
  for (size_t k = 0; k < spoilers.size(); ++k) {
    PoseGraph graph = MakeChain(MakeLap(10, 5), 2);
    graph.nodes[5].camera_from_map.translation.y() += 1;
    spoilers[k](&graph);
    const PoseGraph before = graph;
    EXPECT_FALSE(OptimizePoseGraph(&graph, {}, nullptr).converged_or_stopped) << "case " << k;
    ExpectUnchanged({{graph.nodes[5]}, {}}, {{before.nodes[5]}, {}});
  }
}

TEST(PoseGraphTest, AnEdgeOfANodeThatIsNotThereIsABug) {
  PoseGraph graph = MakeChain(MakeLap(10, 5), 1);
  graph.edges[3].j = 10;
  EXPECT_THROW(OptimizePoseGraph(&graph, {}, nullptr), CheckFailure);
}

TEST(PoseGraphTest, IsDeterministic) {
  const auto truth = MakeLap(60, 20);
  PoseGraph a = MakeChain(DriftingLap(truth, 0.99, {0, 0.01, 0}), 2);
  a.edges.push_back({59, 0, Relative(truth, 59, 0)});
  PoseGraph b = a;
  OptimizePoseGraph(&a, {}, nullptr);
  OptimizePoseGraph(&b, {}, nullptr);
  ExpectUnchanged(a, b);
}

}  // namespace
}  // namespace portolan
