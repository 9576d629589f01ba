#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <string>

#include "features/test_images.h"
#include "tools/run_tool.h"
#include "vocabulary/vocabulary.h"

namespace portolan {
namespace {

using testing::HasSubstr;

Outcome RunTool(const std::string& arguments) {
  return RunProgram(PORTOLAN_VOCABULARY_TOOL, arguments);
}

class VocabularyTool : public testing::Test {
 protected:
  void SetUp() override {
    const std::string test = testing::UnitTest::GetInstance()->current_test_info()->name();
    folder_ =
        std::filesystem::path(testing::TempDir()) / ("portolan_vocabulary_tool_" + test + std::to_string(getpid()));
    std::filesystem::remove_all(folder_);
    std::filesystem::create_directories(folder_ / "images");
    for (uint64_t seed = 1; seed <= 4; ++seed) {
      cv::imwrite(Path("images/" + std::to_string(seed) + ".png"), TexturedImage(200, 160, seed));
    }
    std::ofstream(Path("images/times.txt")) << "not an image\n";
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }
  std::string Path(const std::string& name) const { return (folder_ / name).string(); }

  std::filesystem::path folder_;
};

TEST_F(VocabularyTool, TrainsAFileThatOpens) {
  const Outcome trained =
      RunTool("train " + Path("images") + " -k 4 -L 3 --seed 7 --features 200 -o " + Path("a.pvoc"));
  ASSERT_EQ(trained.exit_code, 0) << trained.output;
  EXPECT_THAT(trained.output, HasSubstr("clusters: 100 %"));
  const auto vocabulary = Vocabulary::Open(Path("a.pvoc"));
  ASSERT_TRUE(vocabulary.ok()) << vocabulary.error().message;
  EXPECT_EQ((*vocabulary)->branching(), 4);
  EXPECT_EQ((*vocabulary)->depth(), 3);
  const Outcome info = RunTool("info " + Path("a.pvoc"));
  EXPECT_EQ(info.exit_code, 0);
  EXPECT_THAT(info.output, HasSubstr("words: " + std::to_string((*vocabulary)->num_words())));
  // The folder is its images, by name.
  const std::string files =
      Path("images/1.png ") + Path("images/2.png ") + Path("images/3.png ") + Path("images/4.png");
  ASSERT_EQ(RunTool("train " + files + " -k 4 -L 3 --seed 7 --features 200 -o " + Path("b.pvoc")).exit_code, 0);
  EXPECT_EQ(Vocabulary::Open(Path("b.pvoc")).value()->hash(), (*vocabulary)->hash());
}

TEST_F(VocabularyTool, ConvertsDbow2Text) {
  std::ofstream text(Path("voc.txt"));
  text << "2 1 0 0\n";
  for (int node = 0; node < 2; ++node) {
    text << "0 1";
    for (int byte = 0; byte < 32; ++byte) text << ' ' << 255 * node;
    text << " 0.5\n";
  }
  text.close();
  const Outcome converted = RunTool("convert " + Path("voc.txt") + " -o " + Path("a.pvoc"));
  EXPECT_EQ(converted.exit_code, 0) << converted.output;
  EXPECT_EQ(Vocabulary::Open(Path("a.pvoc")).value()->num_words(), 2u);
}

TEST_F(VocabularyTool, NamesBadInputAndExitsWithTwo) {
  std::filesystem::create_directory(Path("empty"));
  std::ofstream(Path("images/broken.png")) << "no png";
  const auto expect_refused = [](const std::string& arguments, const std::string& reason) {
    const Outcome outcome = RunTool(arguments);
    EXPECT_EQ(outcome.exit_code, 2) << arguments;
    EXPECT_THAT(outcome.output, HasSubstr(reason));
  };
  const std::string output = " -o " + Path("a.pvoc");
  expect_refused("", "subcommand");
  expect_refused("train " + Path("images/1.png"), "--output");
  expect_refused("train " + Path("images/1.png") + " -k ten" + output, "ten");
  expect_refused("train " + Path("images/1.png") + " -k 1" + output, "branching is 1");
  expect_refused("train " + Path("images/1.png") + " --features 0" + output, "num_features is 0");
  expect_refused("train " + Path("missing.png") + output, Path("missing.png"));
  expect_refused("train " + Path("empty") + output, "no image in it");
  expect_refused("train " + Path("images") + output, "broken.png");
  expect_refused("info " + Path("missing.pvoc"), "No such file");
  expect_refused("info " + Path("images/1.png"), "not a Portolan vocabulary");
  expect_refused("convert " + Path("images/times.txt") + output, "line 1");
  EXPECT_FALSE(std::filesystem::exists(Path("a.pvoc")));
}

TEST_F(VocabularyTool, AnOutputThatCannotBeWrittenIsAFailure) {
  const Outcome outcome = RunTool("train " + Path("images") + " -k 3 -L 2 --features 50 -o " + Path("missing/a.pvoc"));
  EXPECT_EQ(outcome.exit_code, 1);
  EXPECT_THAT(outcome.output, HasSubstr("missing/a.pvoc"));
}

TEST_F(VocabularyTool, HelpIsNoError) {
  const Outcome outcome = RunTool("train --help");
  EXPECT_EQ(outcome.exit_code, 0);
  EXPECT_THAT(outcome.output, HasSubstr("--depth"));
}

}  // namespace
}  // namespace portolan
