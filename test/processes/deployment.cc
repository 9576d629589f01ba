#include "processes/deployment.h"

#include <csignal>

namespace portolan {

void DeploymentTest::StartAll(const std::vector<std::string>& frontend_arguments) {
  for (const char* role : {"atlas_server", "backend_mapper", "loop_closer"}) StartRole(role);
  StartRole("frontend_tracker", frontend_arguments);
}

void DeploymentTest::StartRole(const std::string& role, const std::vector<std::string>& arguments) {
  std::vector<std::string> command = {Program("portolan_" + role), "--out", Out(), "--domain", std::to_string(domain_)};
  command.insert(command.end(), arguments.begin(), arguments.end());
  processes_[role] = Start(command);
}

void DeploymentTest::StartStandby(const std::string& role, const std::vector<std::string>& arguments) {
  std::vector<std::string> command = {Program("portolan_" + role), "--standby", "--out", StandbyOut(), "--domain", std::to_string(domain_)};
  command.insert(command.end(), arguments.begin(), arguments.end());
  processes_["standby/" + role] = Start(command);
}

Ended DeploymentTest::Tool(const std::vector<std::string>& arguments) {
  std::vector<std::string> command = {Program("portolan"), "--domain", std::to_string(domain_)};
  command.insert(command.end(), arguments.begin(), arguments.end());
  return RunToEnd(command);
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

StatusWatch& DeploymentTest::watch() {
  if (!watch_) watch_ = std::make_unique<StatusWatch>(DdsVendor::kFastDds, domain_);
  return *watch_;
}

}  // namespace portolan
