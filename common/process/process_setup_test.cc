#include "process/process_setup.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "dataset/temp_folder.h"
#include "version/version.h"

namespace portolan {
namespace {

using ::testing::HasSubstr;

ProcessSetup Make(std::vector<std::string> arguments, std::string role = "backend_mapper") {
  arguments.insert(arguments.begin(), "portolan");
  std::vector<char*> argv;
  for (std::string& argument : arguments) argv.push_back(argument.data());
  return ProcessSetup::Make(role, "test", static_cast<int>(argv.size()), argv.data(), nullptr,
                            [](ConfigReader*) { return Status(Ok{}); });
}

/// What a failed start says.
std::string Complaint(const std::vector<std::string>& arguments) {
  ::testing::internal::CaptureStderr();
  const ProcessSetup setup = Make(arguments);
  EXPECT_EQ(setup.exit_code, kExitBadInput);
  return ::testing::internal::GetCapturedStderr();
}

TEST(ProcessSetup, HasSaneDefaults) {
  const ProcessSetup setup = Make({});
  ASSERT_FALSE(setup.exit_code);
  EXPECT_EQ(setup.options.robot, 0);
  EXPECT_EQ(setup.options.bus.vendor, DdsVendor::kFastDds);
  EXPECT_EQ(setup.options.bus.partition, "robot_0");
  EXPECT_TRUE(setup.process.IsValid());
}

TEST(ProcessSetup, FlagsAndSetAreTheSame) {
  const ProcessSetup by_flag = Make({"--dds", "cyclonedds", "--domain", "7", "--robot", "3"});
  const ProcessSetup by_set = Make({"--set", "dds.vendor=cyclonedds", "--set", "dds.domain=7", "--set", "robot=3"});
  for (const ProcessSetup* setup : {&by_flag, &by_set}) {
    ASSERT_FALSE(setup->exit_code);
    EXPECT_EQ(setup->options.bus.vendor, DdsVendor::kCycloneDds);
    EXPECT_EQ(setup->options.bus.domain, 7);
    EXPECT_EQ(setup->options.robot, 3);
    EXPECT_EQ(setup->options.bus.partition, "robot_3");
  }
}

TEST(ProcessSetup, LogsGoToTheirFolderAndRotateAsConfigured) {
  const TempFolder folder;
  const ProcessSetup by_out = Make({"--out", folder.Path("out")});
  EXPECT_EQ(by_out.options.log.file, folder.Path("out") + "/logs/backend_mapper.log");
  const std::string logs = folder.Path("var/log");
  const ProcessSetup setup = Make(
      {"--out", folder.Path("out"), "--set", "log.folder=" + logs, "--set", "log.file_mb=1", "--set", "log.files=2"});
  ASSERT_FALSE(setup.exit_code);
  ::testing::internal::CaptureStderr();
  for (int i = 0; i < 5000; ++i) spdlog::info("{:1000}", i);  // 5 MB
  static_cast<void>(::testing::internal::GetCapturedStderr());
  const std::string file = logs + "/backend_mapper.log";
  for (const char* rotated : {"", "1", "2"}) {
    const std::string path = *rotated == '\0' ? file : logs + "/backend_mapper." + rotated + ".log";
    ASSERT_TRUE(std::filesystem::exists(path)) << path;
    EXPECT_LE(std::filesystem::file_size(path), 1u << 20) << path;
  }
  EXPECT_FALSE(std::filesystem::exists(logs + "/backend_mapper.3.log"));
  for (const char* bad : {"log.file_mb=0", "log.files=-1"})
    EXPECT_THAT(Complaint({"--set", bad}), HasSubstr(std::string(bad).substr(0, std::string(bad).find('='))));
  EXPECT_THAT(Complaint({"--set", "log.folder=/proc/no/such"}), HasSubstr("folder of logs '/proc/no/such'"));
}

TEST(ProcessSetup, SecurityTakesTheRolesOwnFolder) {
  const std::string complaint = Complaint({"--security", "/no/such/keys"});
  EXPECT_THAT(complaint, HasSubstr("dds.security: /no/such/keys/backend_mapper: no such folder"));
}

TEST(ProcessSetup, PrioritiesFollowThePapersOrder) {
  int last = -21;
  for (const char* role : {"frontend_tracker", "backend_mapper", "loop_closer", "atlas_server"}) {
    const ProcessSetup setup = Make({}, role);
    EXPECT_GT(setup.options.priority.nice, last) << role;
    last = setup.options.priority.nice;
  }
}

TEST(ProcessSetup, AllButTheTrackerMayStandBy) {
  EXPECT_FALSE(Make({}).options.standby);
  EXPECT_TRUE(Make({"--standby"}).options.standby);
  ::testing::internal::CaptureStderr();
  EXPECT_EQ(Make({"--standby"}, "frontend_tracker").exit_code, kExitBadInput);
  EXPECT_THAT(::testing::internal::GetCapturedStderr(), HasSubstr("--standby"));
}

TEST(ProcessSetup, TwoProcessesDrawDifferentSessions) {
  EXPECT_NE(Make({}).session, Make({}).session);
}

TEST(ProcessSetup, HelpEndsWithSuccess) {
  ::testing::internal::CaptureStdout();
  EXPECT_EQ(Make({"--help"}).exit_code, kExitOk);
  EXPECT_THAT(::testing::internal::GetCapturedStdout(), HasSubstr("--config"));
}

TEST(ProcessSetup, VersionEndsWithSuccess) {
  ::testing::internal::CaptureStdout();
  EXPECT_EQ(Make({"--version"}).exit_code, kExitOk);
  EXPECT_EQ(::testing::internal::GetCapturedStdout(), "portolan_backend_mapper " + BuildDescription() + "\n");
}

TEST(ProcessSetup, NamesWhatIsWrong) {
  EXPECT_THAT(Complaint({"--dds", "rti"}), HasSubstr("rti"));
  EXPECT_THAT(Complaint({"--domain", "999"}), HasSubstr("999"));
  EXPECT_THAT(Complaint({"--config", "/no/such.yaml"}), HasSubstr("/no/such.yaml"));
  EXPECT_THAT(Complaint({"--set", "dds.vendr=fastdds"}), HasSubstr("dds.vendr"));
  EXPECT_THAT(Complaint({"--log-level", "loud"}), HasSubstr("loud"));
  EXPECT_THAT(Complaint({"--out", "/proc/no/place"}), HasSubstr("/proc/no/place"));
}

TEST(ProcessSetup, UnknownKeyInTheFileNamesItsLine) {
  const TempFolder folder;
  const std::string path = folder.path() + "/run.yaml";
  std::ofstream(path) << "robot: 1\ndds:\n  vendr: fastdds\n";
  EXPECT_THAT(Complaint({"--config", path}), HasSubstr(path + ":3"));
}

TEST(ProcessSetup, SectionsOfOtherRolesArePassedOver) {
  EXPECT_FALSE(Make({"--set", "tracker.use_esm=false"}).exit_code);
  EXPECT_FALSE(Make({"--set", "atlas.store=x.db"}).exit_code);
}

}  // namespace
}  // namespace portolan
