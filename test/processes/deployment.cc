#include "processes/deployment.h"

#include <csignal>
#include <filesystem>
#include <utility>

#include "processes/run_output_check.h"

namespace portolan {

void DeploymentTest::StartAll(const std::vector<std::string>& frontend_arguments) {
  for (const char* role : {"atlas_server", "backend_mapper", "loop_closer"}) StartRole(role);
  StartRole("frontend_tracker", frontend_arguments);
}

void DeploymentTest::StartRole(const std::string& name, const std::vector<std::string>& arguments) {
  const auto path = std::filesystem::path(Out()) / name;
  std::vector<std::string> command = {Program("portolan_" + path.filename().string()), "--out", path.parent_path(),
                                      "--domain", std::to_string(domain_)};
  command.insert(command.end(), arguments.begin(), arguments.end());
  processes_[name] = Start(command);
}

void DeploymentTest::StartStandby(const std::string& role, const std::vector<std::string>& arguments) {
  std::vector<std::string> command = {Program("portolan_" + role), "--standby", "--out", StandbyOut(), "--domain",
                                      std::to_string(domain_)};
  command.insert(command.end(), arguments.begin(), arguments.end());
  processes_["standby/" + role] = Start(command);
}

Ended DeploymentTest::Tool(const std::vector<std::string>& arguments) {
  std::vector<std::string> command = {Program("portolan"), "--domain", std::to_string(domain_)};
  command.insert(command.end(), arguments.begin(), arguments.end());
  return RunToEnd(command);
}

void DeploymentTest::ExpectTool(const std::vector<std::string>& arguments, int code, const std::string& output) {
  const Ended ended = Tool(arguments);
  EXPECT_EQ(ended.code, code) << arguments[0] << ": " << ended.output;
  EXPECT_THAT(ended.output, ::testing::HasSubstr(output)) << arguments[0];
}

nlohmann::json DeploymentTest::ToolJson(const std::vector<std::string>& arguments) {
  const Ended ended = Tool(arguments);
  EXPECT_EQ(ended.code, 0) << ended.output;
  nlohmann::json json = nlohmann::json::parse(ended.standard_output, nullptr, false);
  EXPECT_FALSE(json.is_discarded()) << ended.output;
  return json;
}

ProcessStatus DeploymentTest::StatusOf(const std::string& name) {
  const StatusWatch::Heard heard = watch().heard();
  const ProcessStatus* status = heard.OfPid(processes_.at(name)->pid());
  return status == nullptr ? ProcessStatus() : *status;
}

bool DeploymentTest::WaitUntil(const std::string& name, const std::function<bool(const ProcessStatus&)>& condition) {
  return watch().WaitUntil(
      [&](const StatusWatch::Heard& heard) {
        const ProcessStatus* status = heard.OfPid(processes_.at(name)->pid());
        return status != nullptr && condition(*status);
      },
      kProcessDeadline);
}

void DeploymentTest::Kill(const std::string& role) {
  processes_.at(role)->Send(SIGKILL);
  EXPECT_EQ(WaitForEnd(processes_.at(role).get()).code, 128 + SIGKILL);
}

Ended DeploymentTest::Interrupt(const std::string& role) {
  processes_.at(role)->Send(SIGINT);
  return WaitForEnd(processes_.at(role).get());
}

Ended DeploymentTest::WaitForFrontend() {
  return WaitForEnd(processes_.at("frontend_tracker").get());
}

void DeploymentTest::Stop(const std::string& role) {
  processes_.at(role)->Send(SIGSTOP);
}

void DeploymentTest::Continue(const std::string& role) {
  processes_.at(role)->Send(SIGCONT);
}

void DeploymentTest::Rename(const std::string& role, const std::string& name) {
  processes_[name] = std::move(processes_.at(role));
  processes_.erase(role);
}

void DeploymentTest::WaitUntilMapping() {
  ASSERT_TRUE(watch().WaitUntil(
      [](const StatusWatch::Heard& heard) {
        return heard.Figure("backend_mapper", "keyframes_taken") >= 3 &&
               heard.Figure("atlas_server", "keyframes") >= 3 && heard.tracker &&
               heard.tracker->state == TrackingState::kTracking;
      },
      kProcessDeadline))
      << Logs();
}

void DeploymentTest::ExpectGoodEnd(double min_tracked_share) {
  const Ended frontend = WaitForFrontend();
  ASSERT_EQ(frontend.code, 0) << frontend.output << Logs();
  for (const char* role : {"backend_mapper", "loop_closer", "atlas_server"}) EXPECT_EQ(Interrupt(role).code, 0) << role;
  EXPECT_GT(ExpectTrajectory(Out() + "/trajectory.txt").size(), min_tracked_share * static_cast<double>(NumFrames()));
  ExpectAccurate(Truth(), Out() + "/trajectory.txt", 0.01);
  ExpectWholePly(Out() + "/map.ply");
  EXPECT_EQ(Report("frontend_tracker")["maps"], 1);
  ExpectSameMaps(Report("atlas_server"), Report("loop_closer"));
}

StatusWatch& DeploymentTest::watch() {
  if (watch_) return *watch_;
  BusOptions options = TestBusOptions(DdsVendor::kFastDds, domain_);
  options.partition = partition_;
  watch_ = std::make_unique<StatusWatch>(options);
  return *watch_;
}

}  // namespace portolan
