#include "mapping/mapper_config.h"
#include "process/mapper_process.h"

int main(int argc, char** argv) {
  using namespace portolan;
  MapperOptions options;
  const ProcessSetup setup = ProcessSetup::Make(
      "backend_mapper", "Portolan's mapper: builds and refines the map that the atlas_server grants it", argc, argv, nullptr,
      [&](ConfigReader* config) { return ReadMapperOptions(config, &options); });
  if (setup.exit_code) return *setup.exit_code;

  const auto vocabulary_hash = Vocabulary::HashOf(
      setup.options.vocabulary_file.empty() ? Vocabulary::DefaultPath() : setup.options.vocabulary_file);
  if (!vocabulary_hash) {
    spdlog::error("{}", vocabulary_hash.error().message);
    return kExitBadInput;
  }
  ProcessLoop loop(4096);
  std::string priority;
  auto bus = StartProcess(setup.options, &priority);
  if (!bus) {
    spdlog::error("{}", bus.error().message);
    return kExitFailure;
  }
  MapperProcess process(setup, options, *vocabulary_hash, bus->get(), priority, &loop);
  return process.Run();
}
