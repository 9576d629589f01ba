#include "mapping/mapper_options.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

namespace portolan {
namespace {

using ::testing::HasSubstr;

TEST(MapperOptions, DefaultsAreValid) {
  const Status checked = MapperOptions().Check();
  EXPECT_TRUE(checked.ok()) << checked.error().message;
}

TEST(MapperOptions, NamesWhatIsWrong) {
  MapperOptions options;
  options.bundle.max_keyframes = 0;
  const Status checked = options.Check();
  ASSERT_FALSE(checked.ok());
  EXPECT_THAT(checked.error().message, HasSubstr("bundle.max_keyframes is 0"));
  options = MapperOptions();
  options.fusion.chi2 = std::nan("");
  ASSERT_FALSE(options.Check().ok());
  EXPECT_THAT(options.Check().error().message, HasSubstr("fusion.chi2"));
}

}  // namespace
}  // namespace portolan
