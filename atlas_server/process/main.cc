#include <csignal>

#include "process/atlas_config.h"
#include "process/atlas_process.h"

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

  const auto vocabulary_hash = Vocabulary::HashOf(
      setup.options.vocabulary_file.empty() ? Vocabulary::DefaultPath() : setup.options.vocabulary_file);
  if (!vocabulary_hash) {
    spdlog::error("{}", vocabulary_hash.error().message);
    return kExitBadInput;
  }
  std::signal(SIGXFSZ, SIG_IGN);  // a limit on file sizes is a full disk to us: the write fails and says so
  std::unique_ptr<MapStore> store;
  if (const std::string path = StorePath(options, setup.options.out); !path.empty()) {
    auto opened = MapStore::Open(path);
    if (!opened) {
      spdlog::error("{}", opened.error().message);
      return kExitBadInput;
    }
    store = std::move(*opened);
  }
  ProcessLoop loop(4096);
  std::string priority;
  auto bus = StartProcess(setup.options, &priority);
  if (!bus) {
    spdlog::error("{}", bus.error().message);
    return kExitFailure;
  }
  AtlasProcess process(setup, options, *vocabulary_hash, store.get(), bus->get(), priority, &loop);
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
