#include "base/result.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <memory>
#include <string>

namespace portolan {
namespace {

using testing::HasSubstr;

Result<int> Half(int number) {
  if (number % 2 != 0) return Error{"expected an even number, found " + std::to_string(number)};
  return number / 2;
}

TEST(ResultTest, HoldsAValue) {
  const Result<int> half = Half(8);
  ASSERT_TRUE(half.ok());
  EXPECT_TRUE(static_cast<bool>(half));
  EXPECT_EQ(*half, 4);
  EXPECT_EQ(half.value(), 4);
}

TEST(ResultTest, HoldsAReason) {
  const Result<int> half = Half(7);
  EXPECT_FALSE(half);
  EXPECT_EQ(half.error().message, "expected an even number, found 7");
}

TEST(ResultTest, TheValueOfAFailedResultIsABugAndTellsTheReason) {
  const Result<int> half = Half(7);
  try {
    static_cast<void>(half.value());
    FAIL() << "value() of a failed Result must throw";
  } catch (const CheckFailure& failure) {
    EXPECT_THAT(failure.what(), HasSubstr("found 7"));
  }
}

TEST(ResultTest, GivesAwayAValueThatCannotBeCopied) {
  Result<std::unique_ptr<int>> result(std::make_unique<int>(3));
  const std::unique_ptr<int> taken = std::move(result).value();
  EXPECT_EQ(*taken, 3);
}

TEST(ResultTest, LetsItsValueBeChanged) {
  Result<std::string> text(std::string("map"));
  *text += "s";
  EXPECT_EQ(text->size(), 4u);
}

TEST(ResultTest, StatusIsSuccessWithoutAValue) {
  EXPECT_TRUE(Status(Ok{}));
  EXPECT_FALSE(Status(Error{"no"}));
}

}  // namespace
}  // namespace portolan
