#include "transport/vendor_log.h"

#include <dds/dds.h>
#include <dds/ddsrt/log.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <spdlog/sinks/ostream_sink.h>

#include <fastdds/dds/log/Log.hpp>
#include <sstream>

#include "transport/cyclonedds_domain.h"

namespace portolan {
namespace {

using testing::HasSubstr;
using testing::Not;

/// The process's log is a text, and the libraries are as at the start again afterwards.
class VendorLogTest : public testing::Test {
 protected:
  VendorLogTest() {
    spdlog::set_default_logger(
        std::make_shared<spdlog::logger>("test", std::make_shared<spdlog::sinks::ostream_sink_mt>(text_)));
    spdlog::set_pattern("%l %v");
  }
  ~VendorLogTest() override {
    eprosima::fastdds::dds::Log::Reset();
    dds_set_log_sink(nullptr, nullptr);
    spdlog::set_default_logger(before_);
  }
  std::string Text() const { return text_.str(); }

 private:
  const std::shared_ptr<spdlog::logger> before_ = spdlog::default_logger();
  std::ostringstream text_;
};

TEST_F(VendorLogTest, AMessageHasItsVendorAndItsLevel) {
  VendorLog log("Some DDS");
  log.Write(spdlog::level::warn, "send.c", 7, "no route\n");
  EXPECT_EQ(Text(), "warning Some DDS: no route\n");
}

TEST_F(VendorLogTest, APlaceIsHeardOnceASecondAndHidesNoOther) {
  VendorLog log("Some DDS");
  for (int i = 0; i < 1000; ++i) log.Write(spdlog::level::err, "send.c", 7, "no route");
  log.Write(spdlog::level::err, "send.c", 8, "no buffer");
  log.Write(spdlog::level::err, "read.c", 7, "no reader");
  EXPECT_THAT(Text(), HasSubstr("error Some DDS: no route\nerror Some DDS: no buffer\nerror Some DDS: no reader\n"));
}

TEST_F(VendorLogTest, FastDdsWritesNothingToStandardOutput) {
  TakeFastDdsLog();
  testing::internal::CaptureStdout();
  using eprosima::fastdds::dds::Log;
  Log::QueueLog("made no socket", {"transport.cpp", 12, "open", "RTPS"}, Log::Error);
  Log::Flush();
  EXPECT_EQ(testing::internal::GetCapturedStdout(), "");
  EXPECT_EQ(Text(), "error Fast DDS: made no socket\n");
}

TEST_F(VendorLogTest, CycloneDdsSaysWhatIsWrongWithItsConfiguration) {
  TakeCycloneDdsLog();
  testing::internal::CaptureStderr();
  CycloneDdsDomain domain;
  EXPECT_FALSE(domain.Join(229, "<NoSuchElement>1</NoSuchElement>").ok());
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
  EXPECT_THAT(Text(), HasSubstr("Cyclone DDS: "));
  EXPECT_THAT(Text(), HasSubstr("NoSuchElement"));
  EXPECT_THAT(Text(), Not(HasSubstr("\n\n")));
}

TEST_F(VendorLogTest, TheLogMayBeSetUpAnewAndTakenAgain) {
  TakeCycloneDdsLog();
  std::ostringstream later;
  spdlog::set_default_logger(
      std::make_shared<spdlog::logger>("later", std::make_shared<spdlog::sinks::ostream_sink_mt>(later)));
  TakeCycloneDdsLog();
  dds_log(DDS_LC_WARNING, "q_entity.c", 3, "f", "participant %d not allowed\n", 5);
  EXPECT_EQ(Text(), "");
  EXPECT_THAT(later.str(), HasSubstr("Cyclone DDS: participant 5 not allowed"));
}

}  // namespace
}  // namespace portolan
