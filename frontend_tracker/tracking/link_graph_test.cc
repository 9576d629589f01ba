#include "tracking/link_graph.h"

#include <gmock/gmock.h>

#include "testing/map_builder.h"
#include "testing/matchers.h"

namespace portolan {
namespace {

using ::testing::ElementsAre;

const MapId kA(0, 1, 1), kB(0, 1, 2), kC(0, 1, 3), kD(1, 9, 1);
const PoseTolerance kTolerance{1e-5, 1e-4};

class LinkGraphTest : public ::testing::Test {
 protected:
  LinkGraph graph_{[this](MapId map) { return maps_.count(map) == 1 ? &maps_.at(map) : nullptr; }};
  std::map<MapId, Map> maps_;
  const Sim3d b_from_a_{1.5, ExpSO3({0.1, 0.2, 0.3}), {1, 2, 3}};
  const Sim3d c_from_b_{0.5, ExpSO3({-0.4, 0.1, 0}), {0, 5, 1}};
};

TEST_F(LinkGraphTest, FindsTheWayInBothDirections) {
  graph_.Link({kB, {}}, {kA, {}}, b_from_a_);
  graph_.Link({kB, {}}, {kC, {}}, c_from_b_.Inverse());
  ASSERT_TRUE(graph_.Find(kC, kA));
  EXPECT_THAT(*graph_.Find(kC, kA), Sim3Near(c_from_b_ * b_from_a_, PoseTolerance(), 1e-9));
  EXPECT_THAT(*graph_.Find(kA, kC), Sim3Near((c_from_b_ * b_from_a_).Inverse(), PoseTolerance(), 1e-9));
  EXPECT_THAT(*graph_.Find(kB, kB), Sim3Near(Sim3d(), PoseTolerance(), 1e-9));
  EXPECT_FALSE(graph_.Find(kA, kD));
}

TEST_F(LinkGraphTest, TakesTheFewestLinks) {
  graph_.Link({kB, {}}, {kA, {}}, b_from_a_);
  graph_.Link({kC, {}}, {kB, {}}, c_from_b_);
  const Sim3d direct(9, Eigen::Quaterniond::Identity(), {0, 0, 0});
  graph_.Link({kC, {}}, {kA, {}}, direct);
  EXPECT_THAT(*graph_.Find(kC, kA), Sim3Near(direct, PoseTolerance(), 1e-9));
  EXPECT_EQ(graph_.num_links(), 3u);
}

TEST_F(LinkGraphTest, ReachableMapsComeByMutualActivity) {
  graph_.Link({kA, {}}, {kB, {}}, Sim3d());
  graph_.Link({kA, {}}, {kC, {}}, Sim3d());
  graph_.Link({kB, {}}, {kD, {}}, Sim3d());
  EXPECT_THAT(graph_.Reachable(kA), ElementsAre(kB, kC, kD));
  EXPECT_THAT(graph_.Reachable(kA, 1), ElementsAre(kB, kC));
  graph_.NoteActivity(kD, kA);
  graph_.NoteActivity(kA, kD);
  graph_.NoteActivity(kA, kC);
  EXPECT_EQ(graph_.Activity(kD, kA), 2);
  EXPECT_THAT(graph_.Reachable(kA), ElementsAre(kD, kC, kB));
  EXPECT_THAT(graph_.Reachable(MapId(0, 1, 77)), ElementsAre());
}

TEST_F(LinkGraphTest, ALinkFollowsTheCorrectionOfAMap) {
  SyntheticSceneOptions options;
  options.num_views = 4;
  const SyntheticScene scene = MakeSyntheticScene(options);
  MapBuilderOptions builder;
  maps_.emplace(kA, BuildMap(scene, builder));
  graph_.Link({kB, {}}, {kA, scene.views[1].data->id}, b_from_a_);
  const Sim3d new_from_old(1.2, ExpSO3({0, 0.3, 0}), {2, 0, 1});
  builder.map_from_world = new_from_old;
  maps_.at(kA) = BuildMap(scene, builder);
  EXPECT_THAT(*graph_.Find(kB, kA), Sim3Near(b_from_a_ * new_from_old.Inverse(), kTolerance, 1e-5));
  EXPECT_THAT(*graph_.Find(kA, kB), Sim3Near(new_from_old * b_from_a_.Inverse(), kTolerance, 1e-5));
}

TEST_F(LinkGraphTest, LinksOfAFusedMapPassOn) {
  graph_.Link({kB, {}}, {kA, {}}, b_from_a_);
  graph_.Link({kC, {}}, {kB, {}}, c_from_b_);
  const Sim3d d_from_b(0.7, ExpSO3({0, 0, 0.2}), {1, 1, 1});
  graph_.Fuse(kD, kB, d_from_b);
  EXPECT_THAT(*graph_.Find(kD, kA), Sim3Near(d_from_b * b_from_a_, PoseTolerance(), 1e-9));
  EXPECT_THAT(*graph_.Find(kC, kA), Sim3Near(c_from_b_ * b_from_a_, PoseTolerance(), 1e-9));
  EXPECT_TRUE(graph_.AreLinked(kD, kA));
  EXPECT_FALSE(graph_.AreLinked(kB, kA));
}

TEST_F(LinkGraphTest, AForgottenMapIsNoWay) {
  graph_.Link({kB, {}}, {kA, {}}, b_from_a_);
  graph_.Link({kC, {}}, {kB, {}}, c_from_b_);
  graph_.Forget(kB);
  EXPECT_FALSE(graph_.Find(kC, kA));
  EXPECT_EQ(graph_.num_links(), 0u);
}

}  // namespace
}  // namespace portolan
