#include "messages/message_check.h"

#include <gtest/gtest.h>

namespace portolan {
namespace {

TEST(MessageCheckTest, CleanTextIsUtf8WithoutControlCharacters) {
  EXPECT_TRUE(IsCleanText(""));
  EXPECT_TRUE(IsCleanText("two\nlines\tand a tab"));
  EXPECT_TRUE(IsCleanText("caf\xc3\xa9, \xe2\x82\xac, \xf0\x9f\x97\xba"));
  EXPECT_FALSE(IsCleanText(std::string("\0", 1)));
  EXPECT_FALSE(IsCleanText("\x1b[31m"));
  EXPECT_FALSE(IsCleanText("\x7f"));
  EXPECT_FALSE(IsCleanText("\x80"));              // can't lead
  EXPECT_FALSE(IsCleanText("\xc3"));              // cut short
  EXPECT_FALSE(IsCleanText("\xe2\x82"));          // cut short
  EXPECT_FALSE(IsCleanText("\xc3("));             // no continuation
  EXPECT_FALSE(IsCleanText("\xc0\xaf"));          // overlong
  EXPECT_FALSE(IsCleanText("\xe0\x80\xaf"));      // overlong
  EXPECT_FALSE(IsCleanText("\xed\xa0\x80"));      // surrogate
  EXPECT_FALSE(IsCleanText("\xf4\x90\x80\x80"));  // beyond U+10FFFF
}

TEST(MessageCheckTest, KeepsTheFirstReasonWithTheMessagesName) {
  MessageCheck check("Thing");
  check.Id("part", 7);
  EXPECT_TRUE(check.ok());
  check.Id("part", 0);
  check.Require(false, "something later");
  ASSERT_FALSE(check.ok());
  EXPECT_EQ(check.error().message, "Thing: part is none");
}

TEST(MessageCheckTest, UnitQuaternionsMayBeRoundedButNotBent) {
  const double unit[] = {0, 0, 0, 1}, rounded[] = {0, 0, 0, 1 + 1e-9}, bent[] = {0, 0, 0, 1.001};
  MessageCheck check("Thing");
  check.UnitQuaternion("q", unit);
  check.UnitQuaternion("q", rounded);
  EXPECT_TRUE(check.ok());
  check.UnitQuaternion("q", bent);
  EXPECT_FALSE(check.ok());
}

}  // namespace
}  // namespace portolan
