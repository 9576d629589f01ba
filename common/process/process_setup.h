#pragma once

#include <CLI/CLI.hpp>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "base/config_reader.h"
#include "base/ids.h"
#include "base/log.h"
#include "transport/bus.h"
#include "transport/priority.h"

namespace portolan {

/// Exit codes of every Portolan process, for scripts.
enum ExitCode {
  kExitOk = 0,
  kExitFailure = 1,        ///< something went wrong while running
  kExitBadInput = 2,       ///< usage, configuration, calibration, vocabulary or data
  kExitUnreachable = 3,    ///< a process that is needed did not show up
  kExitRefused = 4,        ///< another process has the place already (a second mapper of a robot)
  kExitInterrupted = 130,  ///< the user stopped a run before its end
};

/// What every process is started with: one YAML file for the whole run, single values from the command line over it,
/// defaults in code.
struct ProcessOptions {
  std::string role;  ///< frontend_tracker, backend_mapper, loop_closer, atlas_server; or tool
  RobotId robot = 0;
  BusOptions bus;
  PriorityOptions priority;
  LogOptions log;
  std::string out;              ///< folder for results and logs; empty: none are written
  std::string log_folder;       ///< of ROLE.log; empty: there is none
  std::string vocabulary_file;  ///< empty: the default vocabulary
  /// Follows, and waits to take the place of another process of its role; not of a frontend_tracker.
  bool standby = false;
};

/// A process on its way to start: the command line is parsed, the options are read, the log is set up.
class ProcessSetup {
 public:
  /// @param add_flags adds the role's own flags to the command line; `to_key` maps a flag's text to a configuration
  /// key, so that a flag is the same as
  /// --set. May be null.
  /// @param read_options reads the role's own sections.
  /// On --help, --version and on every mistake (told on standard error, all of them at once), `exit_code` is set and
  /// nothing else holds.
  static ProcessSetup Make(const std::string& role, const std::string& description, int argc, char** argv,
                           const std::function<void(CLI::App*, std::vector<std::string>* assignments)>& add_flags,
                           const std::function<Status(ConfigReader*)>& read_options);

  std::optional<int> exit_code;
  ProcessOptions options;
  ProcessId process;  ///< drawn at start
  uint32_t session = 0;
};

/// Reads the sections that all processes share (robot, dds, priority, log, vocabulary, out) and passes over those of
/// the other roles.
Status ReadProcessOptions(ConfigReader* config, ProcessOptions* options);

}  // namespace portolan
