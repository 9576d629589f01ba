#include "tool/graph_picture.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>

namespace portolan {
namespace {

using ::testing::HasSubstr;

size_t Count(const std::string& text, const std::string& part) {
  size_t count = 0;
  for (size_t at = text.find(part); at != std::string::npos; at = text.find(part, at + 1)) ++count;
  return count;
}

DescribedGraph MakeGraph(uint32_t maps) {
  DescribedGraph described;
  MapGraph::State state;
  for (uint32_t i = 1; i <= maps; ++i) {
    state.maps.push_back(MapId(0, 1, i));
    described.labels[MapId(0, 1, i)].keyframes = 10 * i;
    if (i == 1) continue;
    state.activities.push_back({MapId(0, 1, i - 1), MapId(0, 1, i), 2 * i});
    if (i % 2 == 0) state.links.push_back({MapId(0, 1, i - 1), MapId(0, 1, i), Sim3d(), MapGraph::Origin::kOverlap});
  }
  described.graph = MapGraph(state);
  return described;
}

TEST(GraphPictureTest, HasADotAndANameForEachMapAndALineForEachPair) {
  const std::string svg = DrawMapGraph(MakeGraph(5)).ToSvg();
  EXPECT_EQ(Count(svg, "<circle"), 5u);
  EXPECT_EQ(Count(svg, "<polyline"), 4u);
  for (int i = 1; i <= 5; ++i) EXPECT_THAT(svg, HasSubstr(">0.000001." + std::to_string(i) + "<"));
  EXPECT_THAT(svg, HasSubstr("50 keyframes"));
}

TEST(GraphPictureTest, EmptyAndSingleMapsCanBeDrawn) {
  EXPECT_EQ(Count(DrawMapGraph(DescribedGraph()).ToSvg(), "<circle"), 0u);
  EXPECT_EQ(Count(DrawMapGraph(MakeGraph(1)).ToSvg(), "<circle"), 1u);
}

TEST(GraphPictureTest, ABusierPairHasAWiderLine) {
  DescribedGraph quiet = MakeGraph(2), busy = quiet;
  for (int i = 0; i < 50; ++i) busy.graph.CountSwitch(MapId(0, 1, 1), MapId(0, 1, 2));
  const auto width = [](const std::string& svg) {
    const size_t at = svg.find("stroke-width=\"");
    return std::stod(svg.substr(at + 14));
  };
  EXPECT_GT(width(DrawMapGraph(busy).ToSvg()), width(DrawMapGraph(quiet).ToSvg()));
}

}  // namespace
}  // namespace portolan
