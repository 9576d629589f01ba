// DDS Security with whole processes: keys from make_keys.py, all roles, and strangers beside them.

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <filesystem>

#include "processes/deployment.h"

namespace portolan {
namespace {

using ::testing::HasSubstr;

enum : int { kOk = 0, kBadInput = 2, kUnreachable = 3 };  // docs/configuration.md

class SecurityTest : public DeploymentTest, public ::testing::WithParamInterface<DdsVendor> {
 protected:
  void SetUp() override {
    const Ended made = RunToEnd({Program("../share/portolan/launch_scripts/make_keys.py"), Keys(), "--domain",
                                 std::to_string(domain_), "--partition", "robot_0"});
    ASSERT_EQ(made.code, kOk) << made.output;
  }
  std::string Keys() const { return folder_.Path("keys"); }

  std::vector<std::string> Secured(std::vector<std::string> arguments = {}) const {
    const std::vector<std::string> more = {"--dds", ToString(GetParam()), "--security", Keys()};
    arguments.insert(arguments.end(), more.begin(), more.end());
    return arguments;
  }
  /// `portolan` of the operator, who has keys, or of a stranger, who has none.
  Ended Tool(bool has_keys, std::vector<std::string> arguments) {
    std::vector<std::string> command = {Program("portolan"), "--domain", std::to_string(domain_), "--dds",
                                        ToString(GetParam())};
    if (has_keys) command.insert(command.end(), {"--security", Keys()});
    command.insert(command.end(), arguments.begin(), arguments.end());
    return RunToEnd(command);
  }
  /// Who has keys sees these processes, once the handshakes with all of them are done.
  void ExpectStatusOf(const std::vector<std::string>& roles) {
    const auto deadline = std::chrono::steady_clock::now() + kProcessDeadline;
    std::string status;
    const auto shows = [&](const std::string& role) { return status.find(role) != std::string::npos; };
    while (!std::all_of(roles.begin(), roles.end(), shows) && std::chrono::steady_clock::now() < deadline)
      status = Tool(true, {"status"}).output;
    EXPECT_TRUE(std::all_of(roles.begin(), roles.end(), shows)) << status << Logs();
  }
  /// What a mapper says that can't start.
  Ended StartMapperInVain() {
    return RunToEnd({Program("portolan_backend_mapper"), "--domain", std::to_string(domain_), "--dds",
                     ToString(GetParam()), "--security", Keys()});
  }
};

TEST_P(SecurityTest, ARunGoesAsEverAndAStrangerSeesAndChangesNothing) {
  StatusWatch stranger(GetParam(), domain_);
  for (const char* role : {"atlas_server", "backend_mapper", "loop_closer"}) StartRole(role, Secured());
  StartRole("frontend_tracker", Secured({"--data", Sequence(), "--speed", "lockstep"}));
  const auto false_deltas = stranger.bus()->CreateWriter<MapDeltaChunk>();
  const auto false_requests = stranger.bus()->CreateWriter<Request>();
  const Ended run = WaitForFrontend();
  ASSERT_EQ(run.code, kOk) << run.output << Logs();
  EXPECT_EQ(false_deltas->MatchedReaders() + false_requests->MatchedReaders(), 0);
  const nlohmann::json report = Report("frontend_tracker");
  EXPECT_EQ(report.value("frames", 0u), NumFrames());
  EXPECT_GT(report.value("tracked", 0u), NumFrames() * 8 / 10);
  // The back ends are still there: for who has keys, and for nobody else.
  const std::string ply = folder_.Path("map.ply");
  const Ended exported = Tool(true, {"export", "last", "--ply", ply});
  EXPECT_EQ(exported.code, kOk) << exported.output;
  EXPECT_TRUE(std::filesystem::exists(ply));
  ExpectStatusOf({"backend_mapper", "loop_closer", "atlas_server"});
  const Ended names = Tool(true, {"maps", "--names"});
  EXPECT_EQ(names.code, kOk) << names.output;
  EXPECT_EQ(Tool(false, {"delete", "last", "--timeout", "2"}).code, kUnreachable);
  EXPECT_EQ(Tool(true, {"maps", "--names"}).standard_output, names.standard_output);
  EXPECT_TRUE(stranger.heard().processes.empty());
  EXPECT_FALSE(stranger.heard().tracker);
  for (const char* role : {"loop_closer", "backend_mapper", "atlas_server"}) {
    const Ended ended = Interrupt(role);
    EXPECT_EQ(ended.code, kOk) << role << ": " << ended.output;
    EXPECT_THAT(ended.output, HasSubstr("DDS Security is on")) << role;
  }
}

TEST_P(SecurityTest, ImagesComeFromACameraWithKeysAndFromNoOther) {
  for (const char* role : {"atlas_server", "backend_mapper"}) StartRole(role, Secured());
  StartRole("frontend_tracker", Secured({"--data", "topic", "--camera", Sequence() + "/camera.yaml"}));
  BusOptions options = TestBusOptions(GetParam(), domain_);
  options.credentials_folder = Keys() + "/tool";
  StatusWatch watch(options);
  ASSERT_TRUE(watch.WaitUntil(
      [](const StatusWatch::Heard& heard) {
        const ProcessStatus* frontend = heard.Of("frontend_tracker");
        return frontend != nullptr && frontend->state == "initializing";  // it waits for images
      },
      kProcessDeadline))
      << Logs();
  const auto play = [&](const std::vector<std::string>& more) {
    std::vector<std::string> command = {
        Program("portolan_play"), "--data", Sequence(), "--quiet", "--dds", ToString(GetParam()), "--domain",
        std::to_string(domain_)};
    command.insert(command.end(), more.begin(), more.end());
    return RunToEnd(command);
  };
  EXPECT_EQ(play({"--wait", "2"}).code, kUnreachable);
  const Ended with_keys = play({"--max-frames", "10", "--security", Keys()});
  EXPECT_EQ(with_keys.code, kOk) << with_keys.output << Logs();
}

TEST_P(SecurityTest, KeysThatAreMissingOrForAnotherPartitionStopTheProgramBeforeItStarts) {
  const std::string mapper = Keys() + "/backend_mapper";
  EXPECT_THAT(RunToEnd({Program("portolan_backend_mapper"), "--domain", std::to_string(domain_), "--dds",
                        ToString(GetParam()), "--security", Keys(), "--robot", "3"})
                  .output,
              HasSubstr("does not permit partition robot_3"));
  std::filesystem::rename(mapper + "/key.pem", mapper + "/key.kept");
  Ended ended = StartMapperInVain();
  EXPECT_EQ(ended.code, kBadInput);
  EXPECT_THAT(ended.output, HasSubstr(mapper + "/key.pem: No such file"));
  std::filesystem::remove_all(mapper);
  ended = StartMapperInVain();
  EXPECT_EQ(ended.code, kBadInput);
  EXPECT_THAT(ended.output, HasSubstr(mapper + ": no such folder"));
}

TEST_P(SecurityTest, AnExpiredCertificateStopsTheProgramBeforeItStarts) {
  const std::string mapper = Keys() + "/backend_mapper", ca = Keys() + "/ca/identity_ca";
  const std::string renew = "openssl req -new -key " + mapper + "/key.pem -subj /O=Portolan/CN=backend_mapper | " +
                            "openssl x509 -req -days -1 -CA " + ca + ".cert.pem -CAkey " + ca + ".key.pem -out " +
                            mapper + "/cert.pem 2>/dev/null";
  ASSERT_EQ(std::system(renew.c_str()), 0);
  const Ended ended = StartMapperInVain();
  EXPECT_EQ(ended.code, kBadInput);
  EXPECT_THAT(ended.output, HasSubstr(mapper + "/cert.pem: the certificate expired on "));
}

TEST_P(SecurityTest, ATrackersKeysDoNotMakeAMapper) {
  std::filesystem::remove_all(Keys() + "/backend_mapper");
  std::filesystem::copy(Keys() + "/frontend_tracker", Keys() + "/backend_mapper");
  const Ended ended = StartMapperInVain();
  EXPECT_NE(ended.code, kOk);
  EXPECT_THAT(ended.output, HasSubstr("writer of map_delta"));
}

std::string VendorName(const ::testing::TestParamInfo<DdsVendor>& info) {
  return ToString(info.param);
}
INSTANTIATE_TEST_SUITE_P(Vendors, SecurityTest, ::testing::Values(DdsVendor::kFastDds, DdsVendor::kCycloneDds),
                         VendorName);

}  // namespace
}  // namespace portolan
