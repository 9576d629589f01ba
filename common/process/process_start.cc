#include "process/process_start.h"

#include <malloc.h>

#include <ctime>
#include <opencv2/core/utility.hpp>
#include <utility>

#include "transport/credentials.h"

namespace portolan {
namespace {

// Events: several seconds of keyframes and deltas, for a process that falls behind.
constexpr size_t kLoopCapacity = 4096;

/// One arena and a fixed limit above which memory comes from the system and goes back to it: what a thread frees serves
/// the others, and the arrays of a big bundle adjustment don't stay. Allocations are too few for the threads to wait
/// for each other.
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

/// A certificate that ends while nobody looks stops the next start.
void TellSecurity(const BusOptions& options) {
  if (options.credentials_folder.empty()) return;
  const std::time_t now_s = std::time(nullptr);
  const auto credentials = Credentials::Open(options.credentials_folder, now_s);
  if (!credentials) return;  // since the bus was made
  constexpr int64_t kDayS = 86400, kWarnDays = 14;
  const int64_t days = (credentials->expires_s - now_s) / kDayS;
  spdlog::log(days < kWarnDays ? spdlog::level::warn : spdlog::level::info, "DDS Security is on: {}, for {} more days",
              credentials->subject, days);
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
  TellSecurity(options.bus);
  return start;
}

}  // namespace portolan
