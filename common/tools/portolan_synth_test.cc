#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <string>

#include "base/flat_yaml.h"
#include "dataset/image_source.h"
#include "dataset/temp_folder.h"
#include "tools/run_tool.h"

namespace portolan {
namespace {

using testing::HasSubstr;
using testing::IsEmpty;

/// Two small frames, quickly painted.
constexpr char kSmall[] = "wall --size 64x64 --frames 2 --texture 64 ";

class SynthTool : public testing::Test {
 protected:
  Outcome Run(const std::string& arguments) { return RunProgram(PORTOLAN_TOOL, arguments); }
  void ExpectFailure(const std::string& arguments, int exit_code, const std::string& reason) {
    const Outcome outcome = Run(arguments);
    EXPECT_EQ(outcome.exit_code, exit_code) << arguments << "\n" << outcome.output;
    EXPECT_THAT(outcome.output, HasSubstr(reason)) << arguments;
  }
  std::string To(const std::string& name) const { return " --out " + folder_.Path(name) + " "; }
  const TempFolder folder_;
};

TEST_F(SynthTool, WritesEveryLayoutThatSourcesRead) {
  const auto write = [&](const std::string& layout) {
    const Outcome outcome = Run(kSmall + To(layout) + "--quiet --format png --layout " + layout);
    EXPECT_EQ(outcome.exit_code, 0);
    EXPECT_THAT(outcome.output, IsEmpty());
    SourceOptions options;
    options.data = folder_.Path(layout);
    const auto source = OpenImageSource(options);
    EXPECT_TRUE(source) << (source ? "" : source.error().message);
    EXPECT_EQ(source ? (*source)->NumFrames() : std::nullopt, 2u) << layout;
    return DetectLayout(options.data).value();
  };
  EXPECT_EQ(write("tum"), DatasetLayout::kTum);
  EXPECT_EQ(write("kitti"), DatasetLayout::kKitti);
  EXPECT_EQ(write("euroc"), DatasetLayout::kEuroc);
  EXPECT_TRUE(std::filesystem::exists(folder_.Path("kitti/image_0/000001.png")));
}

TEST_F(SynthTool, TellsItsProgress) {
  const Outcome outcome = Run(kSmall + To("a"));
  EXPECT_EQ(outcome.exit_code, 0);
  EXPECT_THAT(outcome.output, HasSubstr("frame 2 of 2"));
}

TEST_F(SynthTool, TheSeedMakesThePlace) {
  const auto first_picture = [&](const std::string& name, const std::string& seed) {
    EXPECT_EQ(Run(kSmall + To(name) + "--quiet --layout kitti --seed " + seed).exit_code, 0);
    return ReadTextFile(folder_.Path(name + "/image_0/000000.jpg")).value();
  };
  const std::string of_one = first_picture("a", "1");
  EXPECT_EQ(first_picture("b", "1"), of_one);
  EXPECT_NE(first_picture("c", "2"), of_one);
}

TEST_F(SynthTool, WritesIntoAFolderThatIsNotEmptyOnlyByForce) {
  const std::string precious = folder_.Write("a/precious.txt", "data");
  ExpectFailure(kSmall + To("a"), 1, folder_.Path("a") + ": is not empty; expected a new or empty folder");
  EXPECT_FALSE(std::filesystem::exists(folder_.Path("a/rgb")));
  EXPECT_EQ(Run(kSmall + To("a") + "--force --quiet").exit_code, 0);
  EXPECT_TRUE(std::filesystem::exists(folder_.Path("a/rgb.txt")));
  EXPECT_EQ(*ReadTextFile(precious), "data");
  ExpectFailure(kSmall + To("a/precious.txt"), 1, "a/precious.txt: is a file, expected a folder");
}

TEST_F(SynthTool, BadArgumentsExitWithTwoAndWriteNothing) {
  const std::string out = To("a");
  ExpectFailure("", 2, "scene");
  ExpectFailure("wall", 2, "--out");
  ExpectFailure("moon" + out, 2, "scene: 'moon', expected one of ");
  for (const char* size : {"640", "640x", "x480", "640x480x3", "640x480 px", "wide"}) {
    ExpectFailure("wall" + out + "--size '" + size + "'", 2,
                  std::string("--size: '") + size + "', expected WIDTHxHEIGHT as in 640x480");
  }
  ExpectFailure("wall" + out + "--size 10x480", 2, "size: 10x480, expected 64 to 4096 pixels each way");
  ExpectFailure("wall" + out + "--size 640x9999", 2, "size: 640x9999, expected 64 to 4096 pixels each way");
  ExpectFailure("wall" + out + "--size -640x480", 2, "size: -640x480, expected 64 to 4096 pixels each way");
  ExpectFailure("wall" + out + "--layout ros", 2, "ros");
  ExpectFailure("wall" + out + "--format gif", 2, "gif");
  ExpectFailure("wall" + out + "--fps 0", 2, "fps: 0.000000, expected more than 0, at most 1000");
  ExpectFailure("wall" + out + "--frames -1", 2, "frames: -1, expected 0 (the whole way) or more");
  ExpectFailure("wall" + out + "--texture 100", 2, "texture: 100, expected a power of two, 64 to 4096");
  ExpectFailure("wall" + out + "--lens 0.1", 2, "--lens");
  EXPECT_FALSE(std::filesystem::exists(folder_.Path("a")));
}

TEST_F(SynthTool, HelpListsTheScenes) {
  const Outcome help = Run("--help");
  EXPECT_EQ(help.exit_code, 0);
  EXPECT_THAT(help.output, HasSubstr("wall: "));
}

}  // namespace
}  // namespace portolan
