#include "base/log.h"

#include <spdlog/sinks/rotating_file_sink.h>
#include <spdlog/sinks/stdout_color_sinks.h>

#include <memory>
#include <vector>

namespace portolan {

Status SetUpLog(const LogOptions& options) {
  const spdlog::level::level_enum level = spdlog::level::from_str(options.level);
  if (level == spdlog::level::off && options.level != "off") {
    return Error{"log level '" + options.level + "': expected trace, debug, info, warn, error or off"};
  }
  std::vector<spdlog::sink_ptr> sinks{std::make_shared<spdlog::sinks::stderr_color_sink_mt>()};
  if (!options.file.empty()) {
    constexpr size_t kFileBytes = 10u << 20;
    constexpr size_t kFiles = 3;
    try {
      sinks.push_back(std::make_shared<spdlog::sinks::rotating_file_sink_mt>(options.file, kFileBytes, kFiles));
    } catch (const spdlog::spdlog_ex& failure) {
      return Error{"log file '" + options.file + "': " + failure.what()};
    }
  }
  auto logger = std::make_shared<spdlog::logger>(options.process, sinks.begin(), sinks.end());
  logger->set_level(level);
  logger->set_pattern("%H:%M:%S.%e %^%L%$ [%n] %v");
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
