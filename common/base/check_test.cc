#include "base/check.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

namespace portolan {
namespace {

using testing::HasSubstr;

TEST(CheckTest, PassesWhenTheConditionHolds) {
  EXPECT_NO_THROW(PORTOLAN_CHECK(1 + 1 == 2) << "unused");
}

TEST(CheckTest, ThrowsWithPlaceConditionAndValues) {
  const int found = 3;
  try {
    PORTOLAN_CHECK(found == 4) << "found " << found;
    FAIL() << "a failed check must throw";
  } catch (const CheckFailure& failure) {
    EXPECT_THAT(failure.what(), HasSubstr("check_test.cc:"));
    EXPECT_THAT(failure.what(), HasSubstr("found == 4"));
    EXPECT_THAT(failure.what(), HasSubstr("found 3"));
  }
}

TEST(CheckTest, DoesNotEvaluateTheMessageWhenItHolds) {
  int evaluations = 0;
  const auto describe = [&] { return std::to_string(++evaluations); };
  PORTOLAN_CHECK(true) << describe();
  EXPECT_EQ(evaluations, 0);
}

TEST(CheckTest, IsOneStatementInAnIfWithoutBraces) {
  bool other_branch = false;
  if (false)
    PORTOLAN_CHECK(false);
  else
    other_branch = true;
  EXPECT_TRUE(other_branch);
}

}  // namespace
}  // namespace portolan
