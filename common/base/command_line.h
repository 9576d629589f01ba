#pragma once

#include <CLI/CLI.hpp>
#include <optional>

namespace portolan {

/// Exit code of every program for a command line that it can't take.
inline constexpr int kExitUsage = 2;

/// Parses a program's command line. @return the code to exit with if that is all there is to do: --help, --version (0),
/// or a mistake, which has been told on standard error (kExitUsage).
inline std::optional<int> ParseCommandLine(CLI::App* app, int argc, const char* const* argv) {
  try {
    app->parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app->exit(error) == 0 ? 0 : kExitUsage;
  }
  return std::nullopt;
}

}  // namespace portolan
