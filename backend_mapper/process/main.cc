#include "mapping/mapper_config.h"
#include "process/mapper_process.h"
#include "process/process_start.h"

int main(int argc, char** argv) {
  using namespace portolan;
  MapperOptions options;
  const ProcessSetup setup = ProcessSetup::Make(
      "backend_mapper", "Portolan's mapper: builds and refines the map that the atlas_server grants it", argc, argv,
      nullptr, [&](ConfigReader* config) { return ReadMapperOptions(config, &options); });
  if (setup.exit_code) return *setup.exit_code;

  const ProcessStart start = ProcessStart::Make(setup, ProcessStart::Words::kHashAlone);
  if (start.exit_code) return *start.exit_code;
  MapperProcess process(setup, options, start.vocabulary_hash, start.bus.get(), start.priority, start.loop.get());
  return process.Run();
}
