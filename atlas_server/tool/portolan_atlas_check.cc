// portolan_atlas_check: reads an atlas.db that no atlas_server has open, audits its maps and prints what is in it, as
// JSON.

#include <CLI/CLI.hpp>
#include <cstdio>
#include <string>

#include "base/command_line.h"
#include "tool/atlas_check.h"
#include "version/version.h"

int main(int argc, char** argv) {
  using namespace portolan;
  constexpr int kExitUnsound = 1;
  CLI::App app(
      "Audits the maps of an atlas's file and prints what is in it, as JSON. Exit code 1: something is wrong with it.",
      "portolan_atlas_check");
  app.set_version_flag("--version", "portolan_atlas_check " + BuildDescription());
  std::string path;
  app.add_option("file", path, "atlas.db, which no atlas_server has open")->required();
  if (const auto code = ParseCommandLine(&app, argc, argv)) return *code;
  const Result<AtlasCheck> check = CheckAtlas(path);
  if (!check) {
    std::fprintf(stderr, "portolan_atlas_check: %s\n", check.error().message.c_str());
    return kExitUsage;
  }
  std::printf("%s\n", check->report.dump(2).c_str());
  return check->is_sound ? 0 : kExitUnsound;
}
