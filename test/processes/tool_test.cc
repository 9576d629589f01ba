// The command line tool beside an atlas_server, and beside a whole run.

#include <algorithm>
#include <csignal>
#include <filesystem>

#include "map/map_file.h"
#include "map/random_edits.h"
#include "processes/deployment.h"

namespace portolan {
namespace {

using ::testing::HasSubstr;

enum : int { kOk = 0, kUsage = 2, kUnreachable = 3, kRefused = 4 };  // docs/tool.md

class ToolTest : public DeploymentTest {
 protected:
  void StartAtlas() {
    const size_t before = watch().heard().processes.size();
    StartRole("atlas_server");
    ASSERT_TRUE(watch().WaitUntil([&](const StatusWatch::Heard& heard) { return heard.processes.size() > before; },
                                  kProcessDeadline))
        << Logs();
  }
  /// A file with one map, of more keyframes than are kept of those that are in no map (ReplicaSet). @return the map.
  Map WriteMap(const std::string& path) const {
    Map map(MapId(0, 0xabcdef, 1), 3);
    RandomEdits edits(7, &map);
    for (int i = 0; i < 60; ++i) edits.Edit(RandomEdits::kAddKeyFrame);
    for (int i = 0; i < 300; ++i) edits.Next();
    static_cast<void>(map.TakeDelta());
    EXPECT_TRUE(WriteMapFile(path, {&map}).ok());
    return map;
  }
  static size_t CountLines(const std::string& path) {
    const std::string text = ReadWholeFile(path);
    return static_cast<size_t>(std::count(text.begin(), text.end(), '\n'));
  }
};

TEST_F(ToolTest, UsageIsToldBeforeAnybodyIsAsked) {
  for (const std::vector<std::string>& arguments :
       std::vector<std::vector<std::string>>{{},
                                             {"fly"},
                                             {"activate"},
                                             {"fuse", "1"},
                                             {"export", "1"},
                                             {"localize-only", "maybe"},
                                             {"swap"},
                                             {"swap", "frontend_tracker"},
                                             {"maps", "--timeout", "0"},
                                             {"maps", "--domain", "231"},
                                             {"maps", "--dds", "opendds"},
                                             {"maps", "--set", "dds.partition=a b"},
                                             {"maps", "--config", "/no/such/file"},
                                             {"maps", "--log-level", "loud"},
                                             {"maps", "--robot", "-1"}}) {
    const Ended ended = Tool(arguments);
    EXPECT_EQ(ended.code, kUsage) << (arguments.empty() ? "" : arguments.back()) << ": " << ended.output;
    EXPECT_FALSE(ended.output.empty());
  }
  EXPECT_EQ(Tool({"--help"}).code, kOk);
  EXPECT_EQ(Tool({"--version"}).code, kOk);
}

TEST_F(ToolTest, NobodyThereIsToldAfterTheTimeout) {
  ExpectTool({"maps", "--timeout", "1"}, kUnreachable,
             "no atlas_server answered within 1 s (domain " + std::to_string(domain_) + ", partition robot_0)");
  ExpectTool({"status", "--timeout", "1"}, kUnreachable, "no process was heard");
  ExpectTool({"pause", "--timeout", "1"}, kUnreachable, "no atlas_server");
}

TEST_F(ToolTest, RefusalsOfAnAtlasWithoutMapsCarryTheirReasons) {
  StartAtlas();
  ExpectTool({"maps"}, kOk, "no map");
  ExpectTool({"graph"}, kOk, "no map");
  ExpectTool({"save"}, kOk, "ok");
  ExpectTool({"activate", "1"}, kUsage, "the atlas has no map");
  ExpectTool({"export", "last", "--ply", folder_.Path("a.ply")}, kUsage, "the atlas has no map");
  ExpectTool({"global-ba"}, kUsage, "no map is active");
  for (const char* command : {"new-map", "pause", "resume"}) ExpectTool({command}, kRefused, "no tracker");
  ExpectTool({"localize-only", "on"}, kRefused, "no tracker");
  ExpectTool({"pause", "--robot", "7", "--partition", "robot_0"}, kRefused, "robot 7");
  ExpectTool({"load", folder_.Path("none")}, kUsage, "can't be read");
  ExpectTool({"load", folder_.Path("none"), "--there"}, kRefused, "can't be read");
  ExpectTool({"load", folder_.Write("text", "something else")}, kRefused, "no map file");
  const nlohmann::json status = ToolJson({"status", "--json"});
  ASSERT_EQ(status.size(), 1u);
  EXPECT_EQ(status[0]["role"], "atlas_server");
  EXPECT_EQ(status[0]["vendor"], "fastdds");
  EXPECT_EQ(Interrupt("atlas_server").code, 0);
}

/// From a file into an atlas, out of it, into another.
TEST_F(ToolTest, AMapGoesFromAtlasToAtlas) {
  const Map map = WriteMap(folder_.Path("a.pmap"));
  StartAtlas();
  ExpectTool({"load", folder_.Path("a.pmap")}, kOk, "ok: " + ToString(map.id()));
  ExpectTool({"load", folder_.Path("a.pmap")}, kRefused, "already");
  ExpectTool({"maps"}, kOk, "dormant");
  ExpectTool({"maps", "--names"}, kOk, ToString(map.id()));
  EXPECT_EQ(ToolJson({"maps", "--json"})["maps"][0]["keyframes"], map.keyframes().size());
  ExpectTool({"graph", "--svg", folder_.Path("g.svg"), "--dot", folder_.Path("g.dot")}, kOk, "");
  EXPECT_THAT(ReadWholeFile(folder_.Path("g.svg")), HasSubstr(ToString(map.id())));
  EXPECT_THAT(ReadWholeFile(folder_.Path("g.dot")), HasSubstr(ToString(map.id())));

  ExpectTool({"export", "0.abc", "--ply", folder_.Path("b.ply"), "--tum", folder_.Path("b.txt"), "--map",
              folder_.Path("b.pmap")},
             kOk, "keyframes");
  const auto back = ReadMapFile(folder_.Path("b.pmap"));
  ASSERT_TRUE(back.ok()) << back.error().message;
  EXPECT_EQ(HashMap(*RestoreMap(back->at(0), nullptr)), HashMap(map));
  EXPECT_EQ(CountLines(folder_.Path("b.txt")), map.keyframes().size());
  EXPECT_THAT(ReadWholeFile(folder_.Path("b.ply")),
              HasSubstr("element vertex " + std::to_string(map.keyframes().size() + map.points().size())));
  // Away and back in one session: its epochs go on.
  ExpectTool({"delete", "last"}, kOk, "ok");
  ExpectTool({"load", folder_.Path("b.pmap")}, kOk, "ok: " + ToString(map.id()));
  EXPECT_EQ(ToolJson({"maps", "--json"})["maps"][0]["keyframes"], map.keyframes().size());
  ExpectTool({"export", "1", "--map", folder_.Path("c.pmap")}, kOk, "keyframes");
  ExpectTool({"export", "1", "--ply", folder_.Path("no/folder.ply")}, 1, "folder.ply");
  ExpectTool({"export", "7", "--ply", folder_.Path("c.ply")}, kUsage, "no map is called '7'");

  Kill("atlas_server");  // what was acknowledged is on the disk
  std::filesystem::copy_file(Out() + "/atlas.db", folder_.Path("copy.db"));
  std::filesystem::copy_file(Out() + "/atlas.db-wal", folder_.Path("copy.db-wal"));
  StartAtlas();
  ExpectTool({"maps"}, kOk, ToString(map.id()));
  ExpectTool({"delete", "last"}, kOk, "ok");
  ExpectTool({"maps"}, kOk, "no map");
  ExpectTool({"load", folder_.Path("copy.db")}, kOk, "ok: " + ToString(map.id()));
  EXPECT_EQ(ToolJson({"maps", "--json"})["maps"][0]["points"], map.points().size());
  EXPECT_EQ(Interrupt("atlas_server").code, 0);
}

TEST_F(ToolTest, ARunIsSeenAndItsActiveMapExported) {
  StartAll({"--data", Sequence(), "--speed", "0.1"});  // so slow that it goes on while all is asked
  ASSERT_TRUE(watch().WaitUntil(
      [](const StatusWatch::Heard& heard) { return heard.Figure("atlas_server", "keyframes") >= 5; }, kProcessDeadline))
      << Logs();
  ExpectTool({"export", "last", "--dds", "cyclonedds", "--map", folder_.Path("a.pmap")}, kOk, "keyframes");
  const auto exported = ReadMapFile(folder_.Path("a.pmap"));
  ASSERT_TRUE(exported.ok()) << exported.error().message;
  EXPECT_GE(RestoreMap(exported->at(0), nullptr)->keyframes().size(), 5u);
  // On a machine with much to do one may be discovered only after a look that found the others.
  nlohmann::json status;
  const auto deadline = std::chrono::steady_clock::now() + kProcessDeadline;
  while (status.size() < 4 && std::chrono::steady_clock::now() < deadline) status = ToolJson({"status", "--json"});
  EXPECT_EQ(status.size(), 4u) << status.dump();
  ExpectTool({"maps"}, kOk, "active, owner");
  ExpectTool({"delete", "1"}, kRefused, "");
  ExpectTool({"global-ba"}, kOk, "ok");
  EXPECT_EQ(Interrupt("frontend_tracker").code, 130) << Logs();  // as the user would end it
  for (const char* role : {"backend_mapper", "loop_closer", "atlas_server"}) EXPECT_EQ(Interrupt(role).code, 0) << role;
}

}  // namespace
}  // namespace portolan
