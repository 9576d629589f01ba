#include "map_optimization/essential_graph.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <set>

#include "base/check.h"
#include "testing/drifted_map.h"
#include "testing/synthetic_scene.h"

namespace portolan {
namespace {

class EssentialGraphTest : public testing::Test {
 protected:
  void SetUp() override {
    SyntheticSceneOptions options;
    options.landmarks = LandmarkLayout::kStreet;
    options.motion = CameraMotion::kStreetLap;
    options.num_landmarks = 1500;
    options.num_views = 40;
    options.lap = 20;
    options.travel = 18;
    options.sight = 6;
    scene_ = MakeSyntheticScene(options);
    map_ = BuildDriftedMap(scene_, DriftOptions()).map;
  }
  KeyFrameId id(size_t view) const { return scene_.views[view].data->id; }
  static bool HasEdge(const EssentialGraph& graph, KeyFrameId a, KeyFrameId b) {
    const uint32_t i = graph.IndexOf(a), j = graph.IndexOf(b);
    for (const PoseGraph::Edge& e : graph.graph.edges) {
      if ((e.i == i && e.j == j) || (e.i == j && e.j == i)) return true;
    }
    return false;
  }
  SyntheticScene scene_;
  Map map_;
  EssentialGraphOptions options_;
};

TEST_F(EssentialGraphTest, HoldsTheTreeStrongCovisibilityAndLoopEdges) {
  const EssentialGraph graph = MakeEssentialGraph(map_, {{id(39), id(0)}}, options_);
  ASSERT_EQ(graph.keyframes.size(), map_.keyframes().size());
  EXPECT_TRUE(HasEdge(graph, id(39), id(0)));
  for (size_t a = 0; a < 40; ++a) {
    for (size_t b = a + 1; b < 40; ++b) {
      const bool is_tree = b == a + 1, is_strong = map_.Covisibility(id(a), id(b)) >= options_.min_common;
      const bool is_loop = a == 0 && b == 39;
      EXPECT_EQ(HasEdge(graph, id(a), id(b)), is_tree || is_strong || is_loop) << a << " and " << b;
    }
  }
}

TEST_F(EssentialGraphTest, OfAMapAsItIsHasNoError) {
  const EssentialGraph graph = MakeEssentialGraph(map_, {{id(39), id(0)}}, options_);
  for (const PoseGraph::Edge& e : graph.graph.edges) {
    EXPECT_LT(EdgeResidual(graph.graph.nodes[e.i].camera_from_map, graph.graph.nodes[e.j].camera_from_map, e).norm(),
              1e-9);
    EXPECT_NEAR(e.length, map_.MedianDepth(graph.keyframes[e.j]), 1e-12);
  }
  for (size_t k = 0; k < graph.keyframes.size(); ++k) EXPECT_EQ(graph.graph.nodes[k].fixed, k == 0);
}

TEST_F(EssentialGraphTest, CovisibilityIsBoundedAndEdgesComeOnce) {
  options_.min_common = 1;
  options_.max_per_keyframe = 2;
  const EssentialGraph graph = MakeEssentialGraph(map_, {{id(1), id(0)}, {id(0), id(1)}}, options_);
  EXPECT_LE(graph.graph.edges.size(), 40u * 3);
  std::set<std::pair<uint32_t, uint32_t>> pairs;
  for (const PoseGraph::Edge& e : graph.graph.edges) EXPECT_TRUE(pairs.insert(std::minmax(e.i, e.j)).second);
}

TEST_F(EssentialGraphTest, LoopEdgesOfWhatIsGoneArePassedOver) {
  const size_t edges = MakeEssentialGraph(map_, {}, options_).graph.edges.size();
  EXPECT_EQ(MakeEssentialGraph(map_, {{KeyFrameId(9, 9, 9), id(0)}}, options_).graph.edges.size(), edges);
}

TEST_F(EssentialGraphTest, AKeyFrameThatSeesNothingHasItsParentsDepth) {
  for (const MapPointId point : map_.SortedPointIds()) {
    if (map_.point(point).FindObservation(id(20)) != nullptr) map_.RemovePoint(point);
  }
  const EssentialGraph graph = MakeEssentialGraph(map_, {}, options_);
  const double parents = map_.MedianDepth(id(19));
  EXPECT_EQ(graph.depths[20], parents > 0 ? parents : graph.depths[19]);
  EXPECT_GT(graph.depths[20], 0);
}

TEST_F(EssentialGraphTest, AnUnknownKeyFrameIsABug) {
  const EssentialGraph graph = MakeEssentialGraph(map_, {}, options_);
  EXPECT_THROW(graph.IndexOf(KeyFrameId(9, 9, 9)), CheckFailure);
}

}  // namespace
}  // namespace portolan
