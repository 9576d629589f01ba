#include "process/process_start.h"

#include <malloc.h>

#include <opencv2/core/utility.hpp>
#include <utility>

namespace portolan {
namespace {

constexpr size_t kLoopCapacity =
    4096;  // events: several seconds of keyframes and deltas, for a process that falls behind

/// One arena and a fixed limit above which memory comes from the system and goes back to it: what a thread frees serves the others, and
/// the arrays of a big bundle adjustment don't stay. Allocations are too few for the threads to wait for each other.
void KeepHeapSmall() {
  constexpr int kMappedBytes = 4 << 20;
  mallopt(M_ARENA_MAX, 1);
  mallopt(M_MMAP_THRESHOLD, kMappedBytes);
}

/// Opens the vocabulary, or reads its hash alone.
Status FindWords(const std::string& path, ProcessStart::Words words, ProcessStart* start) {
  if (words == ProcessStart::Words::kHashAlone) {
    const auto hash = Vocabulary::HashOf(path);
    if (!hash) return hash.error();
    start->vocabulary_hash = *hash;
    return Ok{};
  }
  auto vocabulary = Vocabulary::Open(path);
  if (!vocabulary) return vocabulary.error();
  start->vocabulary = std::move(*vocabulary);
  start->vocabulary_hash = start->vocabulary->hash();
  return Ok{};
}

}  // namespace

ProcessStart ProcessStart::Make(const ProcessSetup& setup, Words words) {
  KeepHeapSmall();
  const ProcessOptions& options = setup.options;
  ProcessStart start;
  const std::string path = options.vocabulary_file.empty() ? Vocabulary::DefaultPath() : options.vocabulary_file;
  if (Status found = FindWords(path, words, &start); !found) {
    spdlog::error("{}", found.error().message);
    start.exit_code = kExitBadInput;
    return start;
  }
  start.loop = std::make_unique<ProcessLoop>(kLoopCapacity);
  cv::setNumThreads(1);  // four processes share few cores: OpenCV's own threads would only get in each other's way
  for (const std::string& warning : CheckKernelBuffers()) spdlog::warn("{}", warning);
  start.priority = SetPriority(options.priority);
  spdlog::info("robot {} on {}, domain {}, priority {}", options.robot, ToString(options.bus.vendor),
               options.bus.domain, start.priority);
  auto bus = MakeBus(options.bus);
  if (!bus) {
    spdlog::error("{}", bus.error().message);
    start.exit_code = kExitFailure;
    return start;
  }
  start.bus = std::move(*bus);
  return start;
}

}  // namespace portolan
