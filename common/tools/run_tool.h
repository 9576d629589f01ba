#pragma once

#include <sys/wait.h>

#include <cstdio>
#include <string>

#include "base/check.h"

namespace portolan {

/// How a program ended, and what it said.
struct Outcome {
  int exit_code = -1;  ///< -1: a signal ended it
  std::string output;  ///< standard output and error
};

/// Runs a program to its end, for tests. @param arguments for the shell.
inline Outcome RunProgram(const std::string& program, const std::string& arguments) {
  const std::string command = program + " " + arguments + " 2>&1";
  FILE* pipe = popen(command.c_str(), "r");
  PORTOLAN_CHECK(pipe != nullptr) << command;
  Outcome outcome;
  char buffer[4096];
  while (const size_t size = fread(buffer, 1, sizeof buffer, pipe)) outcome.output.append(buffer, size);
  const int status = pclose(pipe);
  if (WIFEXITED(status)) outcome.exit_code = WEXITSTATUS(status);
  return outcome;
}

}  // namespace portolan
