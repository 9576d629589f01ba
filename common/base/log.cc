#include "base/log.h"

#include <spdlog/sinks/rotating_file_sink.h>
#include <spdlog/sinks/stdout_color_sinks.h>

#include <memory>
#include <vector>

namespace portolan {
namespace {

constexpr const char* kPattern = "%H:%M:%S.%e %^%L%$ [%n] %v";

}  // namespace

Status SetUpLog(const LogOptions& options) {
  const spdlog::level::level_enum level = spdlog::level::from_str(options.level);
  if (level == spdlog::level::off && options.level != "off") {
    return Error{"log level '" + options.level + "': expected trace, debug, info, warn, error or off"};
  }
  std::vector<spdlog::sink_ptr> sinks{std::make_shared<spdlog::sinks::stderr_color_sink_mt>()};
  if (!options.file.empty()) {
    const size_t bytes = static_cast<size_t>(options.file_mb) << 20;
    const size_t files = static_cast<size_t>(options.files);
    try {
      sinks.push_back(std::make_shared<spdlog::sinks::rotating_file_sink_mt>(options.file, bytes, files));
    } catch (const spdlog::spdlog_ex& failure) {
      return Error{"log file '" + options.file + "': " + failure.what()};
    }
  }
  for (const spdlog::sink_ptr& sink : sinks) sink->set_pattern(kPattern);
  // A file outlives the day.
  if (!options.file.empty()) sinks.back()->set_pattern(std::string("%Y-%m-%d ") + kPattern);
  auto logger = std::make_shared<spdlog::logger>(options.process, sinks.begin(), sinks.end());
  logger->set_level(level);
  logger->flush_on(spdlog::level::info);
  spdlog::set_default_logger(std::move(logger));
  return Ok{};
}

bool LogThrottle::Allow() {
  const auto now = std::chrono::steady_clock::now();
  if (last_ != std::chrono::steady_clock::time_point{} && now - last_ < std::chrono::seconds(1)) {
    ++held_;
    return false;
  }
  last_ = now;
  last_suppressed_ = held_;
  held_ = 0;
  return true;
}

}  // namespace portolan
