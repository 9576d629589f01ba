// portolan_run_witness: listens to the deltas of a run beside it and writes down which keyframes came into maps and
// went from them by their owners' word, so that a script can tell afterwards whether any was lost. Until SIGINT or
// SIGTERM.
//
//   delta MAP EPOCH BASE REVISION [+KEYFRAME ...] [-KEYFRAME ...]

#include <CLI/CLI.hpp>
#include <cstdio>
#include <string>
#include <utility>

#include "base/command_line.h"
#include "map/map_delta.h"
#include "transport/bus.h"
#include "transport/process_loop.h"

namespace portolan {
namespace {

constexpr size_t kLoopCapacity = 16384;  // a witness that misses something is none
constexpr int kExitFailure = 1;

void WriteDown(const MapDelta& delta, std::FILE* file) {
  std::string line = "delta " + ToString(delta.map) + " " + std::to_string(delta.epoch) + " " +
                     std::to_string(delta.base_revision) + " " + std::to_string(delta.revision);
  for (const MapDelta::KeyFrameState& state : delta.keyframes) line += " +" + ToString(state.id);
  for (const MapDelta::RemovedKeyFrame& removed : delta.removed_keyframes) line += " -" + ToString(removed.id);
  std::fprintf(file, "%s\n", line.c_str());
  std::fflush(file);
}

int Listen(const BusOptions& options, std::FILE* file) {
  ProcessLoop loop(kLoopCapacity);
  auto bus = MakeBus(options);
  if (!bus) {
    std::fprintf(stderr, "portolan_run_witness: %s\n", bus.error().message.c_str());
    return kExitFailure;
  }
  DeltaAssembler assembler;
  {
    const auto reader = (*bus)->CreateReader<MapDeltaChunk>([&](MapDeltaChunk chunk) {
      loop.Post([&, chunk = std::move(chunk)] {
        for (const MapDelta& delta : assembler.Add(chunk)) WriteDown(delta, file);
      });
    });
    loop.Run();
  }
  if (loop.dropped() == 0) return 0;
  std::fprintf(stderr, "portolan_run_witness: missed %llu messages\n", static_cast<unsigned long long>(loop.dropped()));
  return kExitFailure;
}

int Main(int argc, char** argv) {
  CLI::App app("Writes down which keyframes come into the maps of a run and go from them.", "portolan_run_witness");
  BusOptions options;
  std::string vendor = ToString(options.vendor), out;
  app.add_option("--domain", options.domain, "DDS domain")->capture_default_str();
  app.add_option("--dds", vendor, "fastdds or cyclonedds")->capture_default_str();
  app.add_option("--partition", options.partition, "of the run")->capture_default_str();
  app.add_option("--out", out, "file to write")->required();
  if (const auto code = ParseCommandLine(&app, argc, argv)) return *code;
  const auto parsed = ParseDdsVendor(vendor);
  std::FILE* file = parsed ? std::fopen(out.c_str(), "w") : nullptr;
  if (file == nullptr) {
    std::fprintf(stderr, "portolan_run_witness: %s\n",
                 parsed ? (out + " can't be written").c_str() : parsed.error().message.c_str());
    return kExitUsage;
  }
  options.vendor = *parsed;
  const int code = Listen(options, file);
  std::fclose(file);
  return code;
}

}  // namespace
}  // namespace portolan

int main(int argc, char** argv) {
  return portolan::Main(argc, argv);
}
