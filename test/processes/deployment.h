#pragma once

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
  void StartRole(const std::string& role, const std::vector<std::string>& arguments = {});
  /// As by the kernel: without a word to anybody.
  void Kill(const std::string& role);
  /// Ends a process as the user would. @return its exit code and output.
  Ended Interrupt(const std::string& role);
  Ended WaitForFrontend();

  StatusWatch& watch();

 private:
  std::map<std::string, std::unique_ptr<ChildProcess>> processes_;
  std::unique_ptr<StatusWatch> watch_;
};

}  // namespace portolan
