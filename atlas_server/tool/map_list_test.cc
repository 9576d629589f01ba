#include "tool/map_list.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace portolan {
namespace {

using ::testing::HasSubstr;

const char* const kList = R"({"maps": [
  {"map": "0.000001.1", "robot": 0, "epoch": 2, "owner": "0.00000a.1", "owner_alive": true, "active": true, "state_epoch": 1, "revision": 30, "keyframes": 12, "points": 345},
  {"map": "1.000002.1", "robot": 1, "epoch": 5, "owner": "0.0000ff.1", "owner_alive": true, "keyframes": 7, "points": 8},
  {"map": "1.000002.2", "robot": 1, "epoch": 1, "owner": "1.00000b.1", "owner_alive": false, "active": true},
  {"map": "1.000002.3", "robot": 1, "epoch": 0, "owner": "none"}], "last": "0.000001.1"})";

TEST(MapListTest, ReadsTheAtlasServersAnswer) {
  const Result<MapList> list = ParseMapList(kList);
  ASSERT_TRUE(list.ok()) << list.error().message;
  ASSERT_EQ(list->maps.size(), 4u);
  const MapList::Entry* first = list->Find(MapId(0, 1, 1));
  ASSERT_NE(first, nullptr);
  EXPECT_EQ(first->owner, ProcessId(0, 10, 1));
  EXPECT_TRUE(first->owner_alive);
  EXPECT_TRUE(first->is_active);
  EXPECT_EQ(first->epoch, 2u);
  EXPECT_EQ(first->state_epoch, 1u);
  EXPECT_EQ(first->revision, 30u);
  EXPECT_EQ(first->keyframes, 12u);
  EXPECT_EQ(first->points, 345u);
  EXPECT_EQ(list->last, first->map);
  EXPECT_EQ(list->Find(MapId(9, 9, 9)), nullptr);
}

TEST(MapListTest, TellsTheStateOfEachMap) {
  const std::string text = FormatMapList(*ParseMapList(kList));
  EXPECT_THAT(text, HasSubstr("0.000001.1 *"));
  EXPECT_THAT(text, HasSubstr("active, owner 0.00000a.1\n"));
  EXPECT_THAT(text, HasSubstr("dormant\n"));
  EXPECT_THAT(text, HasSubstr("active, its mapper is gone\n"));
  EXPECT_THAT(text, HasSubstr("waits for a mapper\n"));
  EXPECT_EQ(FormatMapList(MapList()), "no map\n");
}

TEST(MapListTest, RefusesWhatIsNoList) {
  for (const char* text :
       {"", "x", "[]", "{}", R"({"maps": 3})", R"({"maps": [{"robot": 0}]})", R"({"maps": [{"map": 7}]})",
        R"({"maps": [{"map": "7"}]})", R"({"maps": [{"map": "0.1.1", "keyframes": "x"}]})"}) {
    const Result<MapList> list = ParseMapList(text);
    ASSERT_FALSE(list.ok()) << text;
    EXPECT_THAT(list.error().message, HasSubstr("list of maps can't be read"));
  }
}

const char* const kGraph = R"({"maps": [
    {"map": "0.000001.1", "robot": 0, "keyframes": 100, "points": 5000, "owner": "none", "active": true},
    {"map": "0.000001.2", "robot": 0, "keyframes": 20, "points": 900, "state": "dormant"}, {"map": "0.000001.3"}],
  "links": [{"map": "0.000001.1", "other": "0.000001.2", "origin": "overlap", "scale": 0.5, "rotation": [0, 0.6, 0, 0.8], "translation": [3, 0, 4]}],
  "activities": [{"map": "0.000001.1", "other": "0.000001.2", "count": 4}, {"map": "0.000001.2", "other": "0.000001.3", "count": 1}],
  "fused": [{"map": "0.000001.1", "other": "0.000001.9", "scale": 1, "rotation": [0, 0, 0, 1], "translation": [0, 0, 0]}]})";

TEST(MapGraphTextTest, ReadsWhatTheAtlasServerAnswersAndTellsIt) {
  const Result<DescribedGraph> graph = ParseMapGraph(kGraph);
  ASSERT_TRUE(graph.ok()) << graph.error().message;
  const MapId first(0, 1, 1), second(0, 1, 2);
  EXPECT_EQ(graph->graph.ActivityOf(first, second), 4u);
  const auto link = graph->graph.FindLink(first, second);
  ASSERT_TRUE(link.has_value());
  EXPECT_EQ(link->map_from_other.scale, 0.5);
  EXPECT_EQ(link->map_from_other.rotation.y(), 0.6);
  EXPECT_EQ(link->map_from_other.translation, Eigen::Vector3d(3, 0, 4));
  EXPECT_TRUE(graph->labels.at(first).is_active);
  EXPECT_FALSE(graph->labels.at(second).is_active);
  const std::string text = FormatMapGraph(*graph);
  EXPECT_THAT(text, HasSubstr("0.000001.1: 100 keyframes, 5000 points, robot 0, active\n"));
  EXPECT_THAT(text, HasSubstr("0.000001.1 - 0.000001.2: activity 4; linked from an overlap: scale 0.500, turned by "
                              "73.7 deg, moved by 5\n"));
  EXPECT_THAT(text, HasSubstr("0.000001.2 - 0.000001.3: activity 1; not linked\n"));
  EXPECT_THAT(text, HasSubstr("0.000001.9 went into 0.000001.1\n"));
  EXPECT_EQ(FormatMapGraph(DescribedGraph()), "no map\n");
}

TEST(MapGraphTextTest, RefusesWhatIsNoGraph) {
  const std::string sound = kGraph;
  const auto with = [&](const std::string& from, const std::string& to) {
    return std::string(sound).replace(sound.find(from), from.size(), to);
  };
  for (const std::string& text : {std::string(), std::string("{}"), with("\"links\"", "\"lines\""),
                                  with("[3, 0, 4]", "[3, 0]"), with("[3, 0, 4]", "[3, 0, \"x\"]"),
                                  with("\"count\": 4", "\"count\": null"), with("\"scale\": 0.5", "\"scala\": 0.5")}) {
    EXPECT_FALSE(ParseMapGraph(text).ok()) << text;
  }
}

}  // namespace
}  // namespace portolan
