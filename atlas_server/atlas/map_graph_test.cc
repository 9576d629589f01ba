#include "atlas/map_graph.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "testing/matchers.h"

namespace portolan {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

const MapId kA(0, 1, 1), kB(0, 1, 2), kC(0, 1, 3), kD(0, 1, 4);
const Sim3d kAFromB(2, ExpSO3({0.1, 0.2, 0.3}), {1, 2, 3}), kBFromC(0.7, ExpSO3({-0.3, 0, 0.1}), {-1, 0, 4});
constexpr PoseTolerance kExact{1e-9, 1e-9};

TEST(MapGraphTest, ANewMapHasOneActivityWithTheMapBesideIt) {
  MapGraph graph;
  graph.AddMap(kA);
  graph.AddNewMap(kB, kA);
  graph.AddNewMap(kC, MapId());
  EXPECT_EQ(graph.ActivityOf(kA, kB), 1u);
  EXPECT_EQ(graph.ActivityOf(kB, kA), 1u);
  EXPECT_EQ(graph.ActivityOf(kA, kC), 0u);
  graph.AddNewMap(kB, kA);  // asked for again
  EXPECT_EQ(graph.ActivityOf(kA, kB), 1u);
}

TEST(MapGraphTest, MapsAreOrderedByActivityThenByAge) {
  MapGraph graph;
  for (const MapId map : {kA, kB, kC, kD}) graph.AddMap(map);
  EXPECT_THAT(graph.ByActivity(kC), ElementsAre(kD, kB, kA));
  graph.CountSwitch(kC, kA);
  graph.CountSwitch(kA, kC);
  graph.CountSwitch(kB, kC);
  EXPECT_THAT(graph.ByActivity(kC), ElementsAre(kA, kB, kD));
  EXPECT_THAT(graph.ByActivity(kD), ElementsAre(kC, kB, kA));
}

TEST(MapGraphTest, LinksAreFoundFromBothEndsAndComposeAlongAWay) {
  MapGraph graph;
  graph.SetLink({kA, kB, kAFromB, MapGraph::Origin::kNewMap});
  graph.SetLink({kC, kB, kBFromC.Inverse(), MapGraph::Origin::kOverlap});
  graph.AddMap(kD);
  EXPECT_THAT(graph.FindLink(kA, kB)->map_from_other, Sim3Near(kAFromB, kExact, 1e-9));
  EXPECT_THAT(graph.FindLink(kB, kA)->map_from_other, Sim3Near(kAFromB.Inverse(), kExact, 1e-9));
  EXPECT_EQ(graph.FindLink(kB, kA)->map, kB);
  EXPECT_EQ(graph.FindLink(kB, kA)->origin, MapGraph::Origin::kNewMap);
  EXPECT_FALSE(graph.FindLink(kA, kC));
  EXPECT_THAT(*graph.FindWay(kA, kC), Sim3Near(kAFromB * kBFromC, kExact, 1e-9));
  EXPECT_THAT(*graph.FindWay(kC, kA), Sim3Near((kAFromB * kBFromC).Inverse(), kExact, 1e-9));
  EXPECT_THAT(*graph.FindWay(kB, kB), Sim3Near(Sim3d(), kExact, 1e-9));
  EXPECT_FALSE(graph.FindWay(kA, kD));
}

TEST(MapGraphTest, WhatIsNoLinkIsLeftOut) {
  MapGraph graph;
  graph.SetLink({kA, kA, Sim3d()});
  graph.SetLink({kA, MapId(), Sim3d()});
  graph.SetLink({kA, kB, Sim3d(-1, Eigen::Quaterniond::Identity(), {0, 0, 0})});
  graph.SetLink({kA, kB, Sim3d(1, Eigen::Quaterniond::Identity(), {0, std::nan(""), 0})});
  EXPECT_EQ(graph.num_links(), 0u);
  graph.CountSwitch(kA, kA);
  graph.CountSwitch(kA, MapId());
  EXPECT_TRUE(graph.state().activities.empty());
}

TEST(MapGraphTest, AFusedMapsLinksAndActivitiesGoToTheOther) {
  MapGraph graph;
  graph.SetLink({kB, kC, kBFromC});
  graph.CountSwitch(kB, kC);
  graph.CountSwitch(kA, kC);
  graph.CountSwitch(kA, kB);
  graph.Merge(kA, kB, kAFromB);
  EXPECT_EQ(graph.maps(), (std::set<MapId>{kA, kC}));
  EXPECT_EQ(graph.ActivityOf(kA, kC), 2u);
  EXPECT_THAT(graph.FindLink(kA, kC)->map_from_other, Sim3Near(kAFromB * kBFromC, kExact, 1e-9));
  EXPECT_EQ(graph.Resolve(kB).first, kA);
  EXPECT_THAT(graph.Resolve(kB).second, Sim3Near(kAFromB, kExact, 1e-9));
  EXPECT_EQ(graph.Resolve(kC).first, kC);
  // What still comes about it changes nothing.
  graph.AddMap(kB);
  graph.SetLink({kB, kC, Sim3d()});
  graph.CountSwitch(kB, kC);
  EXPECT_EQ(graph.maps().count(kB), 0u);
  EXPECT_EQ(graph.ActivityOf(kB, kC), 0u);
}

TEST(MapGraphTest, FusionsFollowOnEachOther) {
  MapGraph graph;
  for (const MapId map : {kA, kB, kC}) graph.AddMap(map);
  graph.Merge(kB, kC, kBFromC);
  graph.Merge(kA, kB, kAFromB);
  EXPECT_EQ(graph.Resolve(kC).first, kA);
  EXPECT_THAT(graph.Resolve(kC).second, Sim3Near(kAFromB * kBFromC, kExact, 1e-9));
}

TEST(MapGraphTest, ARemovedMapIsForgotten) {
  MapGraph graph;
  graph.SetLink({kA, kB, kAFromB});
  graph.CountSwitch(kA, kB);
  graph.Remove(kB);
  EXPECT_EQ(graph.num_links(), 0u);
  EXPECT_EQ(graph.ActivityOf(kA, kB), 0u);
  EXPECT_EQ(graph.Resolve(kB).first, kB);
}

TEST(MapGraphTest, StateRestoresAllOfItAndContradictionsAreLeftOut) {
  MapGraph graph;
  graph.SetLink({kA, kB, kAFromB, MapGraph::Origin::kEntered});
  graph.CountSwitch(kA, kB);
  graph.Merge(kA, kC, kBFromC);
  MapGraph::State state = graph.state();
  const MapGraph restored(state);
  EXPECT_EQ(restored.maps(), graph.maps());
  EXPECT_EQ(restored.ActivityOf(kA, kB), 1u);
  EXPECT_EQ(restored.FindLink(kA, kB)->origin, MapGraph::Origin::kEntered);
  EXPECT_EQ(restored.Resolve(kC).first, kA);
  state.fused.push_back({kC, kD, Sim3d()});  // kC is no map
  state.links.push_back({kC, kB, Sim3d()});
  const MapGraph contradicting(state);
  EXPECT_EQ(contradicting.Resolve(kD).first, kD);
  EXPECT_FALSE(contradicting.FindLink(kC, kB));
}

TEST(MapGraphTest, VersionRisesWithChangesAlone) {
  MapGraph graph;
  graph.AddNewMap(kB, kA);
  const uint64_t version = graph.version();
  graph.AddNewMap(kB, kA);
  graph.AddMap(kA);
  EXPECT_EQ(graph.version(), version);
  graph.CountSwitch(kA, kB);
  EXPECT_GT(graph.version(), version);
}

TEST(MapGraphTest, TellsItselfAsJsonAndForGraphviz) {
  MapGraph graph;
  graph.SetLink({kA, kB, kAFromB, MapGraph::Origin::kOverlap});
  graph.CountSwitch(kA, kB);
  graph.AddNewMap(kC, kA);
  MapLabel label;
  label.keyframes = 7;
  label.is_active = true;
  const auto json = nlohmann::json::parse(ToJson(graph, {{kA, label}}));
  EXPECT_EQ(json["maps"].size(), 3u);
  EXPECT_EQ(json["maps"][0]["keyframes"], 7);
  EXPECT_EQ(json["links"][0]["map"], ToString(kA));
  EXPECT_EQ(json["links"][0]["origin"], "overlap");
  EXPECT_NEAR(json["links"][0]["scale"], 2, 1e-12);
  EXPECT_EQ(json["activities"].size(), 2u);
  const std::string dot = ToDot(graph, {{kA, label}});
  EXPECT_THAT(dot, HasSubstr("7 keyframes, 0 points\", style=bold"));
  EXPECT_THAT(dot, HasSubstr("\"0.000001.1\" -- \"0.000001.2\" [label=\"1 (overlap, scale 2.000)\"]"));
  EXPECT_THAT(dot, HasSubstr("\"0.000001.1\" -- \"0.000001.3\" [label=\"1\", style=dashed]"));
}

}  // namespace
}  // namespace portolan
