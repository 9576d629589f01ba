#include "process/process_setup.h"

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <map>
#include <utility>

#include "base/command_line.h"
#include "version/version.h"

namespace portolan {
namespace {

/// The paper's order of threads (Sec. 2): tracking highest, multiple mapping lowest. Levels from 0 upwards need no
/// permission.
const std::map<std::string, int> kDefaultNice = {
    {"frontend_tracker", 0}, {"backend_mapper", 4}, {"loop_closer", 8}, {"atlas_server", 12}};

/// Sections of the run's configuration that belong to a role.
const std::map<std::string, std::vector<std::string>> kSections = {{"frontend_tracker", {"tracker", "source", "orb"}},
                                                                   {"backend_mapper", {"mapper"}},
                                                                   {"loop_closer", {"loop"}},
                                                                   {"atlas_server", {"atlas"}}};

int Complain(const std::string& role, const std::string& message) {
  std::fprintf(stderr, "portolan_%s: %s\n", role.c_str(), message.c_str());
  return kExitBadInput;
}

Result<ConfigReader> ReadConfig(const std::string& file, const std::vector<std::string>& assignments) {
  Result<ConfigReader> config = file.empty() ? Result<ConfigReader>(ConfigReader()) : ConfigReader::FromFile(file);
  if (!config) return config;
  for (const std::string& assignment : assignments) {
    if (Status set = config->Set(assignment); !set) return set.error();
  }
  return config;
}

Status MakeFolder(const std::string& folder, const std::string& what) {
  if (folder.empty()) return Ok{};
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) return Error{what + " '" + folder + "': " + error.message()};
  return Ok{};
}

}  // namespace

Status ReadProcessOptions(ConfigReader* config, ProcessOptions* options) {
  int robot = options->robot;
  config->Read("robot", &robot, {0, 65535});
  options->robot = static_cast<RobotId>(robot);
  config->Read("out", &options->out);
  if (!options->out.empty()) options->log_folder = options->out + "/logs";
  config->Read("vocabulary.file", &options->vocabulary_file);
  config->Read("log.level", &options->log.level);
  config->Read("log.folder", &options->log_folder);
  config->Read("log.file_mb", &options->log.file_mb, {1, 10000});
  config->Read("log.files", &options->log.files, {0, 1000});
  std::string vendor = ToString(options->bus.vendor);
  config->ReadChoice("dds.vendor", &vendor, {"fastdds", "cyclonedds"});
  if (const Result<DdsVendor> parsed = ParseDdsVendor(vendor)) options->bus.vendor = *parsed;
  config->Read("dds.domain", &options->bus.domain, {0, 230});
  config->Read("dds.peers", &options->bus.peers);
  config->Read("dds.small_datagrams", &options->bus.small_datagrams);
  config->Read("dds.image_topic", &options->bus.image_topic);
  options->bus.partition = "robot_" + std::to_string(options->robot);
  config->Read("dds.partition", &options->bus.partition);
  std::string keys;
  config->Read("dds.security.folder", &keys);
  if (!keys.empty()) options->bus.credentials_folder = keys + "/" + options->role;
  for (const auto& [role, nice] : kDefaultNice) {
    PriorityOptions priority;
    priority.nice = nice;
    config->Read("priority." + role + ".nice", &priority.nice, {-20, 19});
    config->Read("priority." + role + ".realtime", &priority.realtime, {0, 99});
    if (role == options->role) options->priority = priority;
  }
  for (const auto& [role, sections] : kSections) {
    if (role == options->role) continue;
    for (const std::string& section : sections) config->Ignore(section);
  }
  if (Status finished = config->Finish(); !finished) return finished;
  if (Status checked = options->bus.Check(); !checked) return checked;
  return options->priority.Check();
}

ProcessSetup ProcessSetup::Make(const std::string& role, const std::string& description, int argc, char** argv,
                                const std::function<void(CLI::App*, std::vector<std::string>*)>& add_flags,
                                const std::function<Status(ConfigReader*)>& read_options) {
  ProcessSetup setup;
  setup.options.role = role;
  CLI::App app(description, "portolan_" + role);
  app.set_version_flag("--version", app.get_name() + " " + BuildDescription());
  std::string config_file;
  std::vector<std::string> sets, assignments;
  app.add_option("--config", config_file, "YAML file that configures the run (docs/configuration.md)");
  app.add_option("--set", sets, "one value over the file: section.key=value (repeatable)")
      ->take_all()
      ->expected(1)
      ->allow_extra_args(false);
  const auto flag_for = [&](const char* flag, const char* key, const char* help) {
    app.add_option_function<std::string>(
        flag, [&assignments, key](const std::string& value) { assignments.push_back(std::string(key) + "=" + value); },
        help);
  };
  flag_for("--robot", "robot", "number of the robot, 0 to 65535 (default 0)");
  flag_for("--dds", "dds.vendor", "fastdds or cyclonedds (default fastdds)");
  flag_for("--domain", "dds.domain", "DDS domain, 0 to 230 (default 0)");
  flag_for("--security", "dds.security.folder", "folder of make_keys.py's keys: DDS Security is on");
  flag_for("--out", "out", "folder for results and logs");
  flag_for("--log-level", "log.level", "trace, debug, info, warn, error or off");
  if (role != "frontend_tracker") {  // the camera is but one
    app.add_flag("--standby", setup.options.standby,
                 "wait, and follow, to take the place of the one that runs (docs/swap.md)");
  }
  if (add_flags) add_flags(&app, &assignments);
  setup.exit_code = ParseCommandLine(&app, argc, argv);
  if (setup.exit_code) return setup;
  assignments.insert(assignments.end(), sets.begin(), sets.end());
  Result<ConfigReader> config = ReadConfig(config_file, assignments);
  if (!config) {
    setup.exit_code = Complain(role, config.error().message);
    return setup;
  }
  Status status = read_options(&*config);
  if (Status common = ReadProcessOptions(&*config, &setup.options); !common) status = common;
  if (status) status = MakeFolder(setup.options.out, "output folder");
  if (status) status = MakeFolder(setup.options.log_folder, "folder of logs");
  if (status) {
    setup.options.log.process = role;
    if (!setup.options.log_folder.empty()) setup.options.log.file = setup.options.log_folder + "/" + role + ".log";
    status = SetUpLog(setup.options.log);
  }
  if (!status) {
    setup.exit_code = Complain(role, status.error().message);
    return setup;
  }
  setup.session = DrawSession();
  setup.process = ProcessId(setup.options.robot, setup.session, 1);
  return setup;
}

}  // namespace portolan
