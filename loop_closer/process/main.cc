#include "process/loop_process.h"
#include "process/process_start.h"

int main(int argc, char** argv) {
  using namespace portolan;
  LoopOptions options;
  const ProcessSetup setup =
      ProcessSetup::Make("loop_closer", "Portolan's loop closer: finds places seen again, and corrects the map by them",
                         argc, argv, nullptr, [&](ConfigReader* config) { return ReadLoopOptions(config, &options); });
  if (setup.exit_code) return *setup.exit_code;

  const ProcessStart start = ProcessStart::Make(setup);
  if (start.exit_code) return *start.exit_code;
  LoopProcess process(setup, options, start.vocabulary, start.bus.get(), start.priority, start.loop.get());
  return process.Run();
}
