// The command line tool `portolan`: what the processes do, which maps there are, and what is to be done with them.

#include <CLI/CLI.hpp>
#include <cstdio>
#include <functional>
#include <string>
#include <vector>

#include "base/command_line.h"
#include "process/tool_commands.h"
#include "version/version.h"

namespace portolan {
namespace {

using Command = std::function<Status(ToolSession*, const ToolArguments&)>;

struct ToolOptions {
  ToolArguments arguments;
  std::string config_file, log_level = "error";
  std::vector<std::string> sets, assignments;
  double timeout_s = 10;
  Command command;  // what the command line named
};

int Complain(int code, const std::string& message) {
  std::fprintf(stderr, "portolan: %s\n", message.c_str());
  return code;
}

void AddCommonOptions(CLI::App* app, ToolOptions* options) {
  app->add_option("--config", options->config_file, "YAML file of the run (docs/configuration.md)");
  app->add_option("--set", options->sets, "one value over the file: section.key=value (repeatable)")
      ->take_all()
      ->expected(1)
      ->allow_extra_args(false);
  const auto flag_for = [&](const char* flag, const char* key, const char* help) {
    return app->add_option_function<std::string>(
        flag,
        [options, key](const std::string& value) { options->assignments.push_back(std::string(key) + "=" + value); },
        help);
  };
  flag_for("--domain", "dds.domain", "DDS domain, 0 to 230 (default: $PORTOLAN_DOMAIN, or 0)")
      ->envname("PORTOLAN_DOMAIN");
  flag_for("--dds", "dds.vendor", "fastdds or cyclonedds (default fastdds)");
  flag_for("--security", "dds.security.folder", "folder of make_keys.py's keys: DDS Security is on");
  flag_for("--partition", "dds.partition", "of robots that share an atlas_server (default robot_N)");
  app->add_option_function<std::string>(
      "--robot",
      [options](const std::string& value) {
        options->assignments.push_back("robot=" + value);
        options->arguments.robot = value;
      },
      "number of the robot meant");
  app->add_option("--timeout", options->timeout_s, "seconds to wait for an answer (default 10)")
      ->check(CLI::Range(0.1, 3600.0));
  app->add_option("--log-level", options->log_level, "of the tool's own messages (default error)");
}

CLI::App* AddCommand(CLI::App* app, ToolOptions* options, const char* name, const char* help, Command command) {
  CLI::App* added = app->add_subcommand(name, help);
  added->fallthrough()->callback([options, command = std::move(command)] { options->command = command; });
  return added;
}

Command RequestOf(const char* kind) {
  return [kind](ToolSession* session, const ToolArguments& arguments) { return SendRequest(session, kind, arguments); };
}
Command MapRequestOf(const char* kind) {
  return
      [kind](ToolSession* session, const ToolArguments& arguments) { return SendMapRequest(session, kind, arguments); };
}

constexpr const char* kMapHelp = "its name, its number, a unique beginning or end of the name, or 'last'";

void AddViews(CLI::App* app, ToolOptions* options) {
  ToolArguments& arguments = options->arguments;
  auto* status = AddCommand(app, options, "status", "what each process is and does", ShowStatus);
  status->add_flag("--json", arguments.json, "as JSON, with all figures");
  status->add_flag("--watch", arguments.watch, "again each second");
  auto* maps = AddCommand(app, options, "maps", "the maps of the atlas", ShowMaps);
  maps->add_flag("--json", arguments.json, "as the atlas_server answers");
  maps->add_flag("--names", arguments.names, "their names alone");
  auto* graph = AddCommand(app, options, "graph", "how the maps belong together", ShowGraph);
  graph->add_flag("--json", arguments.json, "as the atlas_server answers");
  graph->add_option("--dot", arguments.dot, "write it for Graphviz into this file");
  graph->add_option("--svg", arguments.picture, "draw it into this .svg or .png");
  auto* metrics = AddCommand(app, options, "metrics", "serve all figures to Prometheus", ServeMetrics);
  metrics->add_option("--listen", arguments.listen, "PORT or ADDRESS:PORT (default 127.0.0.1:9470, without --file)");
  metrics->add_option("--file", arguments.metrics_file,
                      "write them into this file, for node_exporter's textfile collector");
}

void AddFileCommands(CLI::App* app, ToolOptions* options) {
  ToolArguments& arguments = options->arguments;
  AddCommand(app, options, "save", "store all that is not stored yet", RequestOf("save"));
  auto* load = AddCommand(app, options, "load", "take the maps of a file into the atlas", LoadMaps);
  load->add_option("FILE", arguments.file, "a map file (export --map) or an atlas.db")->required();
  load->add_flag("--there", arguments.there, "FILE is a path on the atlas_server's machine");
  auto* exported = AddCommand(app, options, "export", "write a map into files", ExportMap);
  exported->add_option("MAP", arguments.map, kMapHelp)->required();
  auto* forms = exported->add_option_group("forms")->require_option(1, 3);
  forms->add_option("--ply", arguments.ply, "points and camera centres");
  forms->add_option("--tum", arguments.tum, "poses of the keyframes");
  forms->add_option("--map", arguments.pmap, "the whole map, for load");
}

void AddMapCommands(CLI::App* app, ToolOptions* options) {
  ToolArguments& arguments = options->arguments;
  AddCommand(app, options, "activate", "a robot is to go on in this map", MapRequestOf("activate"))
      ->add_option("MAP", arguments.map, kMapHelp)
      ->required();
  auto* fuse = AddCommand(app, options, "fuse", "take OTHER into MAP", MapRequestOf("fuse"));
  fuse->add_option("MAP", arguments.map, kMapHelp)->required();
  fuse->add_option("OTHER", arguments.other, "the map that goes into it")->required();
  AddCommand(app, options, "delete", "forget a map for ever", MapRequestOf("delete_map"))
      ->add_option("MAP", arguments.map, kMapHelp)
      ->required();
  AddCommand(app, options, "global-ba", "adjust all of a map", MapRequestOf("global_ba"))
      ->add_option("MAP", arguments.map, "default: the active one");
}

void AddRobotCommands(CLI::App* app, ToolOptions* options) {
  AddCommand(app, options, "new-map", "the robot begins a new map", RequestOf("start_map"));
  AddCommand(app, options, "pause", "the robot takes no more frames", RequestOf("pause"));
  AddCommand(app, options, "resume", "it does again", RequestOf("resume"));
  auto* localize =
      AddCommand(app, options, "localize-only", "on: the robot localises and changes no map; off: it maps again", {});
  auto* is_on = localize->add_option("SWITCH", "on or off")->required()->check(CLI::IsMember({"on", "off"}));
  localize->callback([options, is_on] {
    options->command = RequestOf(is_on->as<std::string>() == "on" ? "localize_only" : "map_again");
  });
}

void AddSwap(CLI::App* app, ToolOptions* options) {
  ToolArguments& arguments = options->arguments;
  auto* swap =
      AddCommand(app, options, "swap", "a process leaves its place to one started with --standby", SwapProcess);
  swap->add_option("ROLE", arguments.role, "mapper, loop_closer or atlas_server")
      ->required()
      ->check(CLI::IsMember({"mapper", "loop_closer", "atlas_server"}));
  swap->add_flag("--json", arguments.json, "as the atlas_server answers");
}

/// The options that the tool shares with the processes, from file and command line.
Status ReadShared(const ToolOptions& options, ProcessOptions* shared) {
  Result<ConfigReader> config =
      options.config_file.empty() ? Result<ConfigReader>(ConfigReader()) : ConfigReader::FromFile(options.config_file);
  if (!config) return config.error();
  for (const auto* list : {&options.assignments, &options.sets}) {
    for (const std::string& assignment : *list) {
      if (Status set = config->Set(assignment); !set) return set;
    }
  }
  return ReadProcessOptions(&*config, shared);
}

int Main(int argc, char** argv) {
  ToolOptions options;
  CLI::App app("Portolan's command line tool: asks and tells the processes of a run", "portolan");
  app.set_version_flag("--version", "portolan " + BuildDescription());
  app.require_subcommand(1)->fallthrough();
  AddCommonOptions(&app, &options);
  AddViews(&app, &options);
  AddFileCommands(&app, &options);
  AddMapCommands(&app, &options);
  AddRobotCommands(&app, &options);
  AddSwap(&app, &options);
  if (const auto code = ParseCommandLine(&app, argc, argv)) return *code;
  ProcessOptions shared;
  shared.role = "tool";
  if (Status read = ReadShared(options, &shared); !read) return Complain(kExitBadInput, read.error().message);
  LogOptions log;
  log.level = options.log_level;
  if (Status set = SetUpLog(log); !set) return Complain(kExitBadInput, set.error().message);
  auto bus = MakeBus(shared.bus);
  if (!bus) return Complain(kExitFailure, bus.error().message);
  ToolSession session(bus->get(), shared.robot, options.timeout_s);
  const Status done = options.command(&session, options.arguments);
  if (done) return kExitOk;
  const std::string where = session.exit_code() == kExitUnreachable ? " (domain " + std::to_string(shared.bus.domain) +
                                                                          ", partition " + shared.bus.partition + ")"
                                                                    : "";
  return Complain(session.exit_code(), done.error().message + where);
}

}  // namespace
}  // namespace portolan

int main(int argc, char** argv) {
  return portolan::Main(argc, argv);
}
