// Bad input that ends a process at its start: the exit code, and a message that names the culprit.

#include <filesystem>
#include <fstream>

#include "processes/process_test.h"
#include "vocabulary/vocabulary.h"

namespace portolan {
namespace {

using ::testing::HasSubstr;

constexpr int kBadInput = 2, kUnreachable = 3;  // docs/configuration.md

class BadInputTest : public ProcessTest {
 protected:
  /// The frontend alone, with arguments after --data.
  Ended RunFrontend(const std::string& data, const std::vector<std::string>& arguments) {
    std::vector<std::string> command = {Program("portolan_frontend_tracker"), "--domain", std::to_string(domain_),
                                        "--data", data};
    command.insert(command.end(), arguments.begin(), arguments.end());
    return RunToEnd(command);
  }
  /// The rendered camera's calibration with one line in place of another's beginning.
  std::string CameraWith(const std::string& key, const std::string& value) const {
    std::ifstream original(Sequence() + "/camera.yaml");
    std::string text;
    for (std::string line; std::getline(original, line);)
      text += (line.rfind(key + ":", 0) == 0 ? key + ": " + value : line) + "\n";
    return folder_.Write("camera_with_" + key + ".yaml", text);
  }
  static std::string DefaultVocabulary() { return Program("../share/portolan/default.pvoc"); }
};

TEST_F(BadInputTest, MissingDataFolderIsNamed) {
  const std::string missing = folder_.Path("no_such_folder");
  const Ended frontend = RunFrontend(missing, {});
  EXPECT_EQ(frontend.code, kBadInput);
  EXPECT_THAT(frontend.output, HasSubstr(missing));
  const Ended run = RunToEnd(RunCommand({"--data", missing}));
  EXPECT_EQ(run.code, kBadInput);
  EXPECT_THAT(run.output, HasSubstr(missing));
}

TEST_F(BadInputTest, FolderThatIsNoDataSetIsNamed) {
  const Ended frontend = RunFrontend(folder_.path(), {});
  EXPECT_EQ(frontend.code, kBadInput);
  EXPECT_THAT(frontend.output, HasSubstr(folder_.path()));
}

TEST_F(BadInputTest, FocalLengthMustBeAPositiveNumber) {
  for (const char* value : {".nan", "-262.5", "0"}) {
    const std::string camera = CameraWith("fx", value);
    const Ended frontend = RunFrontend(Sequence(), {"--camera", camera});
    EXPECT_EQ(frontend.code, kBadInput) << value;
    EXPECT_THAT(frontend.output, HasSubstr(camera)) << value;
    EXPECT_THAT(frontend.output, HasSubstr("fx")) << value;
  }
}

TEST_F(BadInputTest, CameraOfAnotherSizeIsRefused) {
  const Ended frontend = RunFrontend(Sequence(), {"--camera", CameraWith("width", "640")});
  EXPECT_EQ(frontend.code, kBadInput);
  EXPECT_THAT(frontend.output, HasSubstr("320"));
  EXPECT_THAT(frontend.output, HasSubstr("640"));
}

TEST_F(BadInputTest, TimesThatRunBackwardsAreNamedWithTheirLine) {
  const std::string data = CopyOfSequence();
  std::vector<std::string> lines;
  std::ifstream list(data + "/rgb.txt");
  for (std::string line; std::getline(list, line);) lines.push_back(line);
  list.close();
  ASSERT_GT(lines.size(), 50u);
  std::swap(lines[40], lines[45]);
  std::ofstream spoiled(data + "/rgb.txt");
  for (const std::string& line : lines) spoiled << line << "\n";
  spoiled.close();
  const Ended frontend = RunFrontend(data, {});
  EXPECT_EQ(frontend.code, kBadInput);
  EXPECT_THAT(frontend.output,
              HasSubstr("rgb.txt:42"));  // the first line earlier than the one above it, counted from 1
}

TEST_F(BadInputTest, DataSetWithoutAnyOfItsImagesIsRefused) {
  const std::string data = CopyOfSequence();
  std::filesystem::remove_all(data + "/rgb");
  const Ended frontend = RunFrontend(data, {});
  EXPECT_EQ(frontend.code, kBadInput);
  EXPECT_THAT(frontend.output, HasSubstr(data + "/rgb/"));  // the first of them
}

TEST_F(BadInputTest, UnknownKeyIsNamedWithFileAndLine) {
  const std::string config = folder_.Write("run.yaml", "robot: 0\ntracker:\n  no_such_key: 1\n");
  const Ended frontend = RunFrontend(Sequence(), {"--config", config});
  EXPECT_EQ(frontend.code, kBadInput);
  EXPECT_THAT(frontend.output, HasSubstr(config + ":3"));
  EXPECT_THAT(frontend.output, HasSubstr("no_such_key"));
  const Ended run = RunToEnd(RunCommand({"--data", Sequence(), "--config", config}));
  EXPECT_EQ(run.code, kBadInput);
  EXPECT_THAT(run.output, HasSubstr("run.yaml:3"));
}

/// What only one of the back ends reads, and refuses, ends the run: it would be another than was asked for.
TEST_F(BadInputTest, WhatABackEndRefusesEndsTheRun) {
  const std::string no_store = folder_.Write("no_store.db", "This is no atlas.\n");
  for (const auto& [argument, value] :
       std::vector<std::pair<std::string, std::string>>{{"--set", "mapper.no_such_key=1"},
                                                        {"--set", "loop.no_such_key=1"},
                                                        {"--set", "atlas.no_such_key=1"},
                                                        {"--set", "loop.max_verified=-1"},
                                                        {"--atlas", no_store}}) {
    const Ended run = RunToEnd(RunCommand({"--data", Sequence(), argument, value}));
    EXPECT_EQ(run.code, kBadInput) << value << run.output;
    EXPECT_THAT(run.output, HasSubstr(value.substr(0, value.find('=')))) << value;
  }
}

TEST_F(BadInputTest, EachProcessRefusesAVocabularyOfAnotherKindOrCutShort) {
  const std::string other = folder_.Write("other.pvoc", "This is no vocabulary.\n");
  const std::string cut = folder_.Path("cut.pvoc");
  std::filesystem::copy_file(DefaultVocabulary(), cut);
  folder_.CutShort("cut.pvoc", 0.5);
  for (const char* role : {"frontend_tracker", "backend_mapper", "loop_closer", "atlas_server"}) {
    for (const std::string& file : {other, cut}) {
      std::vector<std::string> command = {Program(std::string("portolan_") + role), "--domain", std::to_string(domain_),
                                          "--set", "vocabulary.file=" + file};
      if (role == std::string("frontend_tracker")) command.insert(command.end(), {"--data", Sequence()});
      const Ended process = RunToEnd(command);
      EXPECT_EQ(process.code, kBadInput) << role;
      EXPECT_THAT(process.output, HasSubstr(file)) << role;
    }
  }
}

TEST_F(BadInputTest, FrontendWithoutPeersSaysWhomItMisses) {
  for (const char* vendor : {"fastdds", "cyclonedds"}) {
    // 192.0.2.1 is an address that nobody has (RFC 5737).
    const Ended frontend = RunFrontend(
        Sequence(), {"--dds", vendor, "--set", "source.peer_timeout_s=2", "--set", "dds.peers=[192.0.2.1]"});
    EXPECT_EQ(frontend.code, kUnreachable) << vendor;
    EXPECT_THAT(frontend.output, HasSubstr("backend_mapper")) << vendor;
    EXPECT_THAT(frontend.output, HasSubstr("atlas_server")) << vendor;
    EXPECT_THAT(frontend.output, HasSubstr(std::to_string(domain_))) << vendor;
  }
}

}  // namespace
}  // namespace portolan
