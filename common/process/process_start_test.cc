#include "process/process_start.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <csignal>
#include <filesystem>

#include "transport/bus_testing.h"

namespace portolan {
namespace {

using ::testing::HasSubstr;

const std::string kVocabulary =
    (std::filesystem::path(__FILE__).parent_path() / "../vocabulary/default.pvoc").lexically_normal();

ProcessSetup SetupOf(DdsVendor vendor, const std::string& vocabulary_file) {
  ProcessSetup setup;
  setup.options.role = "atlas_server";
  setup.options.bus = TestOptions(vendor);
  setup.options.vocabulary_file = vocabulary_file;
  return setup;
}

class ProcessStartTest : public ::testing::TestWithParam<DdsVendor> {};

TEST_P(ProcessStartTest, GivesAllThatAProcessWorksWith) {
  const ProcessStart start = ProcessStart::Make(SetupOf(GetParam(), kVocabulary));
  ASSERT_FALSE(start.exit_code);
  EXPECT_GT(start.vocabulary->num_words(), 0u);
  EXPECT_THAT(start.priority, HasSubstr("nice"));
  // The signals are the loop's: this one ends it, and not the test.
  raise(SIGTERM);
  EXPECT_EQ(start.loop->Run(), SIGTERM);
  EXPECT_EQ(start.bus->CreateWriter<ProcessStatus>()->MatchedReaders(), 0);
}

INSTANTIATE_TEST_SUITE_P(Vendors, ProcessStartTest, ::testing::Values(DdsVendor::kFastDds, DdsVendor::kCycloneDds),
                         [](const auto& parameter) { return ToString(parameter.param); });

TEST(ProcessStart, StopsAtAVocabularyThatCannotBeOpened) {
  ASSERT_TRUE(SetUpLog({}));
  ::testing::internal::CaptureStderr();
  const ProcessStart start = ProcessStart::Make(SetupOf(DdsVendor::kFastDds, "/no/such.pvoc"));
  EXPECT_EQ(start.exit_code, kExitBadInput);
  EXPECT_EQ(start.bus, nullptr);
  EXPECT_THAT(::testing::internal::GetCapturedStderr(), HasSubstr("/no/such.pvoc"));
}

TEST(ProcessStart, StopsWhereDdsCannotBeJoined) {
  ProcessSetup setup = SetupOf(DdsVendor::kCycloneDds, kVocabulary);
  setup.options.bus.domain = -1;
  EXPECT_EQ(ProcessStart::Make(setup).exit_code, kExitFailure);
}

}  // namespace
}  // namespace portolan
