#include "version/version.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace portolan {
namespace {

TEST(Version, IsThreeNumbersThenTheCommitThenTheKindOfBuild) {
  EXPECT_THAT(BuildDescription(), ::testing::MatchesRegex("[0-9]+\\.[0-9]+\\.[0-9]+ ([0-9a-f]+ )?[A-Za-z]+"));
}

}  // namespace
}  // namespace portolan
