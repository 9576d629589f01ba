#pragma once

#include <sys/types.h>

#include <chrono>
#include <optional>
#include <string>
#include <vector>

namespace portolan {

/// A program that a test starts. Its output goes to files, waiting for its end has a deadline, and it does not outlive
/// the test.
class ChildProcess {
 public:
  /// @param command program and arguments. @param output_file takes standard output; standard error goes to
  ///   `output_file`.err.
  ChildProcess(const std::vector<std::string>& command, std::string output_file);
  ~ChildProcess();
  ChildProcess(const ChildProcess&) = delete;
  ChildProcess& operator=(const ChildProcess&) = delete;

  /// Waits for its end. @return its exit code as a shell has it (128 + n: killed by signal n); none when the deadline
  /// came first.
  std::optional<int> Wait(std::chrono::seconds deadline);
  void Send(int signal) const;
  /// What it wrote so far: standard output, where a program's result is, and both, standard error last.
  std::string StandardOutput() const;
  std::string Output() const;
  pid_t pid() const { return pid_; }

 private:
  std::string output_file_, error_file_;
  pid_t pid_ = -1;
  int pid_fd_ = -1;  // readable when the process has ended
  std::optional<int> exit_code_;
};

}  // namespace portolan
