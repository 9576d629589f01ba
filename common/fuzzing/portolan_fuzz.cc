// portolan_fuzz_NAME: libFuzzer's program for one target (fuzz_targets.h). PORTOLAN_FUZZ_TARGET is the target's name.
// PORTOLAN_FUZZ_SEEDS=FOLDER has it write the target's seeds there before it begins.

#include <cstdlib>
#include <fstream>

#include "base/check.h"
#include "fuzzing/fuzz_targets.h"

namespace {

const portolan::FuzzTarget& Target() {
  static const portolan::FuzzTarget* target = portolan::FindFuzzTarget(PORTOLAN_FUZZ_TARGET);
  PORTOLAN_CHECK(target != nullptr) << PORTOLAN_FUZZ_TARGET;
  return *target;
}

}  // namespace

extern "C" int LLVMFuzzerInitialize(int*, char***) {
  const char* folder = std::getenv("PORTOLAN_FUZZ_SEEDS");
  if (folder == nullptr) return 0;
  int number = 0;
  for (const auto& seed : Target().make_seeds()) {
    std::ofstream file(std::string(folder) + "/seed_" + std::to_string(number++), std::ios::binary);
    file.write(reinterpret_cast<const char*>(seed.data()), static_cast<std::streamsize>(seed.size()));
    PORTOLAN_CHECK(file.good()) << "can't write seeds into " << folder;
  }
  return 0;
}

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  Target().run(data, size);
  return 0;
}
