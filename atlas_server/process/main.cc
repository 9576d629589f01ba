#include <csignal>

#include "process/atlas_config.h"
#include "process/atlas_process.h"
#include "process/process_start.h"

namespace portolan {
namespace {

int Main(int argc, char** argv) {
  AtlasOptions options;
  const ProcessSetup setup = ProcessSetup::Make(
      "atlas_server", "Portolan's atlas: grants maps to their owners, follows and stores them", argc, argv,
      [](CLI::App* app, std::vector<std::string>* assignments) {
        app->add_option_function<std::string>(
            "--store", [assignments](const std::string& value) { assignments->push_back("atlas.store=" + value); },
            "file of the atlas (default: atlas.db in --out; 'none': nothing is stored)");
      },
      [&](ConfigReader* config) { return ReadAtlasOptions(config, &options); });
  if (setup.exit_code) return *setup.exit_code;

  std::signal(SIGXFSZ, SIG_IGN);  // a limit on file sizes is a full disk to us: the write fails and says so
  std::unique_ptr<MapStore> store;
  AtlasProcess::OpenStore open_later;
  if (const std::string path = StorePath(options, setup.options.out); !path.empty()) {
    auto opened = MapStore::Open(path);
    if (!opened && setup.options.standby && MapStore::IsInUse(opened.error())) {
      spdlog::info("atlas store '{}' is another atlas_server's until that one leaves", path);
      open_later = [path] { return MapStore::Open(path); };
    } else if (!opened) {
      spdlog::error("{}", opened.error().message);
      return kExitBadInput;
    }
    if (opened) store = std::move(*opened);
  }
  const ProcessStart start = ProcessStart::Make(setup);
  if (start.exit_code) return *start.exit_code;
  AtlasProcess process(setup, options, start.vocabulary, std::move(store), std::move(open_later), start.bus.get(),
                       start.priority, start.loop.get());
  if (Status loaded = process.LoadStore(); !loaded) {
    spdlog::error("{}", loaded.error().message);
    return kExitBadInput;
  }
  return process.Run();
}

}  // namespace
}  // namespace portolan

int main(int argc, char** argv) {
  return portolan::Main(argc, argv);
}
