#include "dataset/text_table.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "dataset/temp_folder.h"

namespace portolan {
namespace {

using testing::ElementsAre;

TEST(TextTableTest, SplitsAtBlanksTabsAndCommasAndKeepsLineNumbers) {
  const TempFolder folder;
  const auto rows = ReadTextTable(folder.Write("t.txt", "# head\n\na b\tc\r\n  1,2 ,3\n#x\nlast"));
  ASSERT_TRUE(rows);
  ASSERT_EQ(rows->size(), 3u);
  EXPECT_EQ((*rows)[0].line, 3);
  EXPECT_THAT((*rows)[0].fields, ElementsAre("a", "b", "c"));
  EXPECT_EQ((*rows)[1].line, 4);
  EXPECT_THAT((*rows)[1].fields, ElementsAre("1", "2", "3"));
  EXPECT_EQ((*rows)[2].line, 6);
}

TEST(TextTableTest, NamesAFileThatIsNotThere) {
  EXPECT_EQ(ReadTextTable("/nowhere/t.txt").error().message,
            "/nowhere/t.txt: can't be opened: No such file or directory");
}

TEST(TextTableTest, SecondsAreExactToTheNanosecond) {
  EXPECT_EQ(ParseSeconds("1403636579.763555527")->ns, 1403636579763555527);  // a double would be off by 119 ns
  EXPECT_EQ(ParseSeconds("0")->ns, 0);
  EXPECT_EQ(ParseSeconds("0.033333")->ns, 33333000);
  EXPECT_EQ(ParseSeconds("-1.5")->ns, -1500000000);
  EXPECT_EQ(ParseSeconds("0.0000000005")->ns, 1) << "a tenth digit rounds";
  EXPECT_EQ(ParseSeconds("1.037359e-01")->ns, 103735900);
  EXPECT_EQ(ParseSeconds("7.")->ns, 7000000000);
}

TEST(TextTableTest, WhatIsNoTimeIsRefused) {
  for (const char* bad : {"", "-", "x", "1.2.3", "nan", "inf", "1s", "99999999999", "1e300", "0.1.", "1,5"}) {
    EXPECT_FALSE(ParseSeconds(bad)) << bad;
  }
  for (const char* bad : {"", "1.5", "1e9", "9223372036854775808", "ns"}) EXPECT_FALSE(ParseNanoseconds(bad)) << bad;
}

TEST(TextTableTest, FormattedSecondsReadBackExactly) {
  for (const int64_t ns :
       {int64_t{0}, int64_t{1}, int64_t{-1}, int64_t{1403636579763555527}, int64_t{-1500000001}, int64_t{999999999}}) {
    EXPECT_EQ(ParseSeconds(FormatSeconds(Timestamp{ns}))->ns, ns) << FormatSeconds(Timestamp{ns});
  }
  EXPECT_EQ(FormatSeconds(Timestamp{1500000000}), "1.500000000");
}

}  // namespace
}  // namespace portolan
