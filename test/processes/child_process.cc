#include "processes/child_process.h"

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstring>
#include <fstream>
#include <sstream>
#include <utility>

#include "base/check.h"

namespace portolan {
namespace {

pid_t Spawn(const std::vector<std::string>& command, const std::string& output_file, const std::string& error_file) {
  std::vector<char*> arguments;
  for (const std::string& argument : command) arguments.push_back(const_cast<char*>(argument.c_str()));
  arguments.push_back(nullptr);
  posix_spawn_file_actions_t files;
  posix_spawn_file_actions_init(&files);
  posix_spawn_file_actions_addopen(&files, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  constexpr int kAppend = O_WRONLY | O_CREAT | O_APPEND;
  posix_spawn_file_actions_addopen(&files, STDOUT_FILENO, output_file.c_str(), kAppend, 0644);
  posix_spawn_file_actions_addopen(&files, STDERR_FILENO, error_file.c_str(), kAppend, 0644);
  pid_t pid = -1;
  const int error = posix_spawn(&pid, command.front().c_str(), &files, nullptr, arguments.data(), environ);
  posix_spawn_file_actions_destroy(&files);
  PORTOLAN_CHECK(error == 0) << command.front() << ": " << std::strerror(error);
  return pid;
}

std::string TextOf(const std::string& file) {
  std::ostringstream text;
  text << std::ifstream(file).rdbuf();
  return text.str();
}

/// By its number: glibc 2.36 declares pidfd_open() without C linkage.
int OpenPidFd(pid_t pid) {
  return static_cast<int>(syscall(SYS_pidfd_open, pid, 0));
}

}  // namespace

ChildProcess::ChildProcess(const std::vector<std::string>& command, std::string output_file)
    : output_file_(std::move(output_file)),
      error_file_(output_file_ + ".err"),
      pid_(Spawn(command, output_file_, error_file_)),
      pid_fd_(OpenPidFd(pid_)) {
  PORTOLAN_CHECK(pid_fd_ >= 0) << "pidfd_open: " << std::strerror(errno);
}

ChildProcess::~ChildProcess() {
  if (!exit_code_) {
    Send(SIGKILL);
    waitpid(pid_, nullptr, 0);
  }
  close(pid_fd_);
}

std::optional<int> ChildProcess::Wait(std::chrono::seconds deadline) {
  if (exit_code_) return exit_code_;
  pollfd ended{pid_fd_, POLLIN, 0};
  if (poll(&ended, 1, static_cast<int>(std::chrono::milliseconds(deadline).count())) != 1) return std::nullopt;
  int status = 0;
  PORTOLAN_CHECK(waitpid(pid_, &status, 0) == pid_);
  exit_code_ = WIFSIGNALED(status) ? 128 + WTERMSIG(status) : WEXITSTATUS(status);
  return exit_code_;
}

void ChildProcess::Send(int signal) const {
  if (!exit_code_) kill(pid_, signal);
}

std::string ChildProcess::StandardOutput() const {
  return TextOf(output_file_);
}

std::string ChildProcess::Output() const {
  return StandardOutput() + TextOf(error_file_);
}

}  // namespace portolan
