#pragma once

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "processes/process_test.h"

namespace portolan {

/// A test that starts the four processes one by one, without run.sh, to kill and replace single ones.
class DeploymentTest : public ProcessTest {
 protected:
  /// Starts atlas_server, backend_mapper, loop_closer and frontend_tracker, all into Out().
  void StartAll(const std::vector<std::string>& frontend_arguments);
  /// @param name the process's role; or FOLDER/ROLE, with a folder below Out() for its results: of several robots.
  void StartRole(const std::string& name, const std::vector<std::string>& arguments = {});
  /// A second process of the role, which stands by; its name is "standby/ROLE", its results are in StandbyOut().
  void StartStandby(const std::string& role, const std::vector<std::string>& arguments = {});
  std::string StandbyOut() const { return folder_.Path("standby"); }
  /// `portolan` in this test's domain.
  Ended Tool(const std::vector<std::string>& arguments);
  /// The same, with the exit code and a part of the output that are expected.
  void ExpectTool(const std::vector<std::string>& arguments, int code, const std::string& output);
  /// The same, of a command that prints JSON.
  nlohmann::json ToolJson(const std::vector<std::string>& arguments);
  /// Waits for the end of a process, by role or name.
  Ended WaitFor(const std::string& name) { return WaitForEnd(processes_.at(name).get()); }
  /// What it told of itself last; empty if it has not yet.
  ProcessStatus StatusOf(const std::string& name);
  /// Waits for a process to say something of itself. @return whether it came.
  bool WaitUntil(const std::string& name, const std::function<bool(const ProcessStatus&)>& condition);
  /// As by the kernel: without a word to anybody.
  void Kill(const std::string& role);
  /// Ends a process as the user would. @return its exit code and output.
  Ended Interrupt(const std::string& role);
  Ended WaitForFrontend();
  /// Stopped, it keeps its connections and does nothing, as a process that hangs.
  void Stop(const std::string& role);
  void Continue(const std::string& role);
  /// The process goes on under another name here, so that a second one of its role can be started.
  void Rename(const std::string& role, const std::string& name);

  /// Until there is a map to lose.
  void WaitUntilMapping();
  /// The frontend comes to its end; the others are told to, and left what they should.
  void ExpectGoodEnd(double min_tracked_share = 0.8);

  StatusWatch& watch();
  std::string partition_ = BusOptions().partition;  ///< of the processes that are watched

 private:
  std::map<std::string, std::unique_ptr<ChildProcess>> processes_;
  std::unique_ptr<StatusWatch> watch_;
};

}  // namespace portolan
