#include "base/config_reader.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

namespace portolan {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

struct Options {
  bool gray = false;
  int features = 2000;
  int64_t bytes = 1;
  double factor = 1.2;
  std::string vendor = "fastdds";
  std::vector<std::string> peers{"localhost"};
};

void ReadAll(ConfigReader* reader, Options* options) {
  reader->Read("tracker.gray", &options->gray);
  reader->Read("tracker.features", &options->features, {100, 20000});
  reader->Read("tracker.bytes", &options->bytes);
  reader->Read("tracker.orb.factor", &options->factor, {1.05, 2});
  reader->ReadChoice("dds.vendor", &options->vendor, {"fastdds", "cyclonedds"});
  reader->Read("dds.peers", &options->peers);
}

/// Reads a text with all the options above; the message of Finish(), empty when all is well.
std::string Read(const std::string& text, Options* options, const std::vector<std::string>& assignments = {}) {
  Result<ConfigReader> reader = ConfigReader::FromText(text, "run.yaml");
  if (!reader) return reader.error().message;
  for (const std::string& assignment : assignments) {
    if (Status set = reader->Set(assignment); !set) return set.error().message;
  }
  ReadAll(&*reader, options);
  reader->Ignore("mapper");
  const Status finished = reader->Finish();
  return finished ? "" : finished.error().message;
}

TEST(ConfigReaderTest, ReadsEveryType) {
  Options options;
  EXPECT_EQ(Read("tracker:\n  gray: true\n  features: 1500\n  bytes: 5000000000\n  orb: {factor: 1.5}\n"
                 "dds:\n  vendor: cyclonedds\n  peers: [10.0.0.1, 10.0.0.2]\n",
                 &options),
            "");
  EXPECT_TRUE(options.gray);
  EXPECT_EQ(options.features, 1500);
  EXPECT_EQ(options.bytes, 5000000000);
  EXPECT_EQ(options.factor, 1.5);
  EXPECT_EQ(options.vendor, "cyclonedds");
  EXPECT_THAT(options.peers, ElementsAre("10.0.0.1", "10.0.0.2"));
}

TEST(ConfigReaderTest, AbsentKeysAndEmptySectionsKeepTheDefaults) {
  Options options;
  EXPECT_EQ(Read("tracker:\ndds: {}\n", &options), "");
  EXPECT_EQ(options.features, 2000);
  EXPECT_EQ(options.vendor, "fastdds");
  EXPECT_THAT(options.peers, ElementsAre("localhost"));
}

TEST(ConfigReaderTest, WorksWithoutAFile) {
  ConfigReader reader;
  Options options;
  ASSERT_TRUE(reader.Set("tracker.features=300"));
  ReadAll(&reader, &options);
  EXPECT_TRUE(reader.Finish());
  EXPECT_EQ(options.features, 300);
}

struct BadValue {
  std::string yaml;
  std::string message;
};

class ConfigReaderBadValueTest : public testing::TestWithParam<BadValue> {};

TEST_P(ConfigReaderBadValueTest, NamesFileLineKeyExpectationAndValueAndKeepsTheDefault) {
  Options options;
  EXPECT_EQ(Read("tracker:\n  " + GetParam().yaml, &options), "run.yaml:2: tracker." + GetParam().message);
  EXPECT_FALSE(options.gray);
  EXPECT_EQ(options.features, 2000);
  EXPECT_EQ(options.factor, 1.2);
}

INSTANTIATE_TEST_SUITE_P(
    All, ConfigReaderBadValueTest,
    testing::Values(
        BadValue{"gray: 1", "gray: expected true or false, found '1'"},
        BadValue{"features: many", "features: expected a whole number from 100 to 20000, found 'many'"},
        BadValue{"features: 99", "features: expected a whole number from 100 to 20000, found '99'"},
        BadValue{"features: 1500.5", "features: expected a whole number from 100 to 20000, found '1500.5'"},
        BadValue{"features: 99999999999", "features: expected a whole number from 100 to 20000, found '99999999999'"},
        BadValue{"features: [1, 2]", "features: expected a whole number from 100 to 20000, found [1, 2]"},
        BadValue{"features:", "features: expected a whole number from 100 to 20000, found nothing"},
        BadValue{"bytes: 1e3", "bytes: expected a whole number, found '1e3'"},
        BadValue{"orb: {factor: .nan}", "orb.factor: expected a finite number from 1.05 to 2, found '.nan'"},
        BadValue{"orb: {factor: .inf}", "orb.factor: expected a finite number from 1.05 to 2, found '.inf'"},
        BadValue{"orb: {factor: 1}", "orb.factor: expected a finite number from 1.05 to 2, found '1'"}));

TEST(ConfigReaderTest, NamesTheChoices) {
  Options options;
  EXPECT_EQ(Read("dds:\n  vendor: opendds\n", &options),
            "run.yaml:2: dds.vendor: expected one of fastdds, cyclonedds, found 'opendds'");
  EXPECT_EQ(Read("dds:\n  peers: a\n", &options), "run.yaml:2: dds.peers: expected a list [a, b, ...], found 'a'");
}

TEST(ConfigReaderTest, RefusesUnknownKeysAndNamesTheNearest) {
  Options options;
  EXPECT_EQ(Read("tracker:\n  feature: 3\n", &options),
            "run.yaml:2: unknown key 'tracker.feature'; did you mean 'tracker.features'?");
  EXPECT_EQ(Read("zebra: 1\n", &options), "run.yaml:1: unknown key 'zebra'");
  EXPECT_EQ(Read("maper:\n  window: 3\n", &options),
            "run.yaml:2: unknown key 'maper.window'; did you mean section 'mapper'?");
  EXPECT_THAT(Read("tracker:\n  features:\n    few: 3\n", &options), HasSubstr("unknown key 'tracker.features.few'"));
  EXPECT_THAT(Read("tracker: 5\n", &options), HasSubstr("unknown key 'tracker'"));
}

TEST(ConfigReaderTest, PassesOverSectionsOfOtherProcessesOnly) {
  Options options;
  EXPECT_EQ(Read("mapper:\n  anything: 3\n  deep: {er: [1]}\n", &options), "");
  EXPECT_THAT(Read("mapper2:\n  anything: 3\n", &options), HasSubstr("unknown key 'mapper2.anything'"));
}

TEST(ConfigReaderTest, TellsAllMistakesAtOnce) {
  Options options;
  const std::string message = Read("tracker:\n  gray: 7\n  featurs: 3\ndds:\n  vendor: x\n", &options);
  EXPECT_THAT(message, HasSubstr("run.yaml:2: tracker.gray"));
  EXPECT_THAT(message, HasSubstr("run.yaml:3: unknown key 'tracker.featurs'"));
  EXPECT_THAT(message, HasSubstr("run.yaml:5: dds.vendor"));
}

TEST(ConfigReaderTest, RefusesAKeyGivenTwice) {
  Options options;
  EXPECT_EQ(Read("tracker:\n  gray: true\n  gray: false\n", &options),
            "run.yaml:3: key 'tracker.gray' is given twice, first on line 2");
}

TEST(ConfigReaderTest, SetOverridesTheFileAndTheLastOneCounts) {
  Options options;
  EXPECT_EQ(Read("tracker:\n  features: 1500\n", &options,
                 {"tracker.features=700", "tracker.features=800", "dds.peers=[a, b]", "dds.vendor=cyclonedds"}),
            "");
  EXPECT_EQ(options.features, 800);
  EXPECT_EQ(options.vendor, "cyclonedds");
  EXPECT_THAT(options.peers, ElementsAre("a", "b"));
}

TEST(ConfigReaderTest, SetIsCheckedLikeTheFile) {
  Options options;
  EXPECT_EQ(Read("", &options, {"tracker.gray=maybe"}), "--set: tracker.gray: expected true or false, found 'maybe'");
  EXPECT_THAT(Read("", &options, {"tracker.grey=true"}), HasSubstr("did you mean 'tracker.gray'"));
  EXPECT_THAT(Read("", &options, {"tracker.gray"}), HasSubstr("expected key=value"));
  EXPECT_THAT(Read("", &options, {"=true"}), HasSubstr("expected key=value"));
  EXPECT_THAT(Read("", &options, {"tracker.gray={a: b}"}), HasSubstr("expected a plain value or a list"));
  EXPECT_THAT(Read("", &options, {"tracker.gray=1\nother: 2"}), HasSubstr("expected a plain value or a list"));
}

TEST(ConfigReaderTest, AValueOfSetMayContainAnEqualsSign) {
  ConfigReader reader;
  std::string filter;
  ASSERT_TRUE(reader.Set("log.filter=a=b"));
  reader.Read("log.filter", &filter);
  EXPECT_TRUE(reader.Finish());
  EXPECT_EQ(filter, "a=b");
}

TEST(ConfigReaderTest, HasTellsWhatIsGiven) {
  const Result<ConfigReader> reader = ConfigReader::FromText("a: {b: 1}", "run.yaml");
  EXPECT_TRUE(reader->Has("a.b"));
  EXPECT_FALSE(reader->Has("a.c"));
}

TEST(ConfigReaderTest, AMissingFileIsNamed) {
  EXPECT_EQ(ConfigReader::FromFile("/nowhere/run.yaml").error().message,
            "/nowhere/run.yaml: can't be opened: No such file or directory");
}

}  // namespace
}  // namespace portolan
