#include "base/flat_yaml.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

namespace portolan {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

std::string FailureOf(const std::string& text) {
  const auto parsed = ParseFlatYaml(text, "run.yaml");
  return parsed ? "no failure" : parsed.error().message;
}

TEST(FlatYamlTest, JoinsSectionsByDotsAndKeepsLines) {
  const auto entries = ParseFlatYaml("# a run\ntracker:\n  orb:\n    levels: 8\n  names: [a, b]\nempty:\n", "run.yaml");
  ASSERT_TRUE(entries);
  ASSERT_EQ(entries->size(), 3u);
  EXPECT_EQ((*entries)[0].key, "tracker.orb.levels");
  EXPECT_EQ((*entries)[0].line, 4);
  EXPECT_FALSE((*entries)[0].is_list);
  EXPECT_THAT((*entries)[0].values, ElementsAre("8"));
  EXPECT_TRUE((*entries)[1].is_list);
  EXPECT_THAT((*entries)[1].values, ElementsAre("a", "b"));
  EXPECT_EQ((*entries)[2].key, "empty");
  EXPECT_TRUE((*entries)[2].values.empty());
}

TEST(FlatYamlTest, NothingIsAnEmptyDocument) {
  EXPECT_TRUE(ParseFlatYaml("", "x")->empty());
  EXPECT_TRUE(ParseFlatYaml("# only a comment\n", "x")->empty());
}

TEST(FlatYamlTest, NamesFileAndLineOfEveryFault) {
  EXPECT_THAT(FailureOf("a: 1\nb: [1, 2\n"), HasSubstr("run.yaml:3: not valid YAML"));
  EXPECT_EQ(FailureOf("s:\n  a: 1\n  b: 2\n  a: 3\n"), "run.yaml:4: key 's.a' is given twice, first on line 2");
  EXPECT_EQ(FailureOf("s.a: 1\ns:\n  a: 2\n"), "run.yaml:3: key 's.a' is given twice, first on line 1");
  EXPECT_EQ(FailureOf("a: 1\n[x, y]: 2\n"), "run.yaml:2: expected a plain word as key");
  EXPECT_EQ(FailureOf("a: [1, [2]]\n"), "run.yaml:1: list 'a' may hold only plain values");
  EXPECT_THAT(FailureOf("just words\n"), HasSubstr("expected 'key: value' lines"));
  EXPECT_THAT(FailureOf("a: 1\n---\nb: 2\n"), HasSubstr("expected one YAML document, found 2"));
}

TEST(FlatYamlTest, EndsOnADocumentThatContainsItself) {
  EXPECT_THAT(FailureOf("a: &x\n  b: *x\n"), testing::AnyOf(HasSubstr("nested too deep"), HasSubstr("not valid YAML")));
}

TEST(FlatYamlTest, ParsesWholeNumbersOnly) {
  int64_t whole = 5;
  EXPECT_TRUE(ParseNumber("-12", &whole));
  EXPECT_EQ(whole, -12);
  EXPECT_TRUE(ParseNumber("+7", &whole));
  EXPECT_EQ(whole, 7);
  for (const char* bad : {"", " 1", "1 ", "1.0", "1e3", "0x10", "9223372036854775808", "+-1", "abc"}) {
    EXPECT_FALSE(ParseNumber(bad, &whole)) << "'" << bad << "'";
  }
  EXPECT_EQ(whole, 7) << "a failure leaves the value alone";
}

TEST(FlatYamlTest, ParsesFiniteNumbersOnly) {
  double number = 5;
  EXPECT_TRUE(ParseNumber("1e-3", &number));
  EXPECT_EQ(number, 1e-3);
  EXPECT_TRUE(ParseNumber("-.5", &number));
  for (const char* bad : {"", "nan", ".nan", "inf", "-inf", "1e999", "1,5", "1.2.3", "0x1p3", "one"}) {
    EXPECT_FALSE(ParseNumber(bad, &number)) << "'" << bad << "'";
  }
  EXPECT_EQ(number, -0.5);
}

TEST(FlatYamlTest, FindsTheNearestWord) {
  const std::vector<std::string> words{"num_features", "num_levels", "scale"};
  EXPECT_EQ(NearestWord("num_feature", words), "num_features");
  EXPECT_EQ(NearestWord("numlevels", words), "num_levels");
  EXPECT_EQ(NearestWord("scale", words), "scale");
  EXPECT_EQ(NearestWord("vocabulary", words), "");
  EXPECT_EQ(NearestWord("x", {}), "");
}

TEST(FlatYamlTest, ReadingAFolderOrNothingNamesThePath) {
  EXPECT_EQ(ReadTextFile("/tmp").error().message, "/tmp: expected a file, found a folder");
  EXPECT_EQ(ReadTextFile("/nowhere/x.yaml").error().message,
            "/nowhere/x.yaml: can't be opened: No such file or directory");
}

}  // namespace
}  // namespace portolan
