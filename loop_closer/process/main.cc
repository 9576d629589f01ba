#include "process/loop_process.h"

int main(int argc, char** argv) {
  using namespace portolan;
  const ProcessSetup setup =
      ProcessSetup::Make("loop_closer", "Portolan's loop closer: follows the maps and reports on them", argc, argv,
                         nullptr, [](ConfigReader*) { return Status(Ok{}); });
  if (setup.exit_code) return *setup.exit_code;

  const auto vocabulary = Vocabulary::Open(setup.options.vocabulary_file.empty() ? Vocabulary::DefaultPath()
                                                                                 : setup.options.vocabulary_file);
  if (!vocabulary) {
    spdlog::error("{}", vocabulary.error().message);
    return kExitBadInput;
  }
  ProcessLoop loop(4096);
  std::string priority;
  auto bus = StartProcess(setup.options, &priority);
  if (!bus) {
    spdlog::error("{}", bus.error().message);
    return kExitFailure;
  }
  LoopProcess process(setup, *vocabulary, bus->get(), priority, &loop);
  return process.Run();
}
