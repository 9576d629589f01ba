#include "optimization/pose_graph_start.h"

#include <gtest/gtest.h>

#include "geometry/geometry_test_utils.h"

namespace portolan {
namespace {

/// Random nodes with exact edges between neighbours and across, and one loop.
PoseGraph MakeConsistentGraph(uint64_t seed) {
  Random random(seed);
  PoseGraph graph;
  for (int k = 0; k < 20; ++k) graph.nodes.push_back({RandomSim3(&random), k == 0});
  const auto connect = [&](uint32_t i, uint32_t j) {
    const Sim3d j_from_i = graph.nodes[j].camera_from_map * graph.nodes[i].camera_from_map.Inverse();
    graph.edges.push_back({i, j, j_from_i, random.Uniform(0.5, 2), random.Uniform(0.5, 2)});
  };
  for (uint32_t k = 1; k < 20; ++k) connect(k - 1, k);
  for (uint32_t k = 3; k < 20; ++k) connect(k, k - 3);
  connect(19, 0);
  return graph;
}

void ExpectSimilar(const Sim3d& a, const Sim3d& b, double tolerance) {
  EXPECT_LT(a.rotation.angularDistance(b.rotation), tolerance);
  EXPECT_LT((a.translation - b.translation).norm(), tolerance);
  EXPECT_NEAR(a.scale, b.scale, tolerance);
}

TEST(SpreadErrorsTest, FindsAConsistentGraphFromAnywhere) {
  for (uint64_t seed = 1; seed < 6; ++seed) {
    const PoseGraph truth = MakeConsistentGraph(seed);
    PoseGraph lost = truth;
    Random random(seed + 100);
    for (PoseGraph::Node& node : lost.nodes) {
      if (!node.fixed) node.camera_from_map = RandomSim3(&random);
    }
    const PoseGraph found = SpreadErrors(lost, false);
    for (size_t k = 0; k < truth.nodes.size(); ++k) {
      ExpectSimilar(found.nodes[k].camera_from_map, truth.nodes[k].camera_from_map, 1e-4);
    }
  }
}

TEST(SpreadErrorsTest, KeepsScalesWhenAsked) {
  PoseGraph graph = MakeConsistentGraph(1);
  for (PoseGraph::Node& node : graph.nodes) node.camera_from_map.scale = 3;
  for (const PoseGraph::Node& node : SpreadErrors(graph, true).nodes) EXPECT_EQ(node.camera_from_map.scale, 3);
}

TEST(SpreadErrorsTest, FixedNodesStayAndHoldTheOthers) {
  PoseGraph graph = MakeConsistentGraph(2);
  graph.nodes[10].fixed = true;
  graph.nodes[10].camera_from_map.translation.x() += 0.5;
  const PoseGraph spread = SpreadErrors(graph, false);
  EXPECT_EQ(spread.nodes[10].camera_from_map.translation, graph.nodes[10].camera_from_map.translation);
  EXPECT_EQ(spread.nodes[0].camera_from_map.translation, graph.nodes[0].camera_from_map.translation);
  EXPECT_NE(spread.nodes[9].camera_from_map.translation, graph.nodes[9].camera_from_map.translation);
}

TEST(SpreadErrorsTest, APartWithoutAFixedNodeStaysNearItsPlace) {
  PoseGraph graph = MakeConsistentGraph(3);
  for (PoseGraph::Node& node : graph.nodes) node.fixed = false;
  const PoseGraph spread = SpreadErrors(graph, false);
  for (size_t k = 0; k < graph.nodes.size(); ++k) {
    ExpectSimilar(spread.nodes[k].camera_from_map, graph.nodes[k].camera_from_map, 1e-4);
  }
}

}  // namespace
}  // namespace portolan
