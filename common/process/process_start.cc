#include "process/process_start.h"

#include <opencv2/core/utility.hpp>
#include <utility>

namespace portolan {
namespace {

constexpr size_t kLoopCapacity =
    4096;  // events: several seconds of keyframes and deltas, for a process that falls behind

}  // namespace

ProcessStart ProcessStart::Make(const ProcessSetup& setup) {
  const ProcessOptions& options = setup.options;
  ProcessStart start;
  auto vocabulary =
      Vocabulary::Open(options.vocabulary_file.empty() ? Vocabulary::DefaultPath() : options.vocabulary_file);
  if (!vocabulary) {
    spdlog::error("{}", vocabulary.error().message);
    start.exit_code = kExitBadInput;
    return start;
  }
  start.vocabulary = std::move(*vocabulary);
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
