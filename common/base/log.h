#pragma once

#include <spdlog/spdlog.h>

#include <chrono>
#include <string>

#include "base/result.h"

namespace portolan {

struct LogOptions {
  std::string process = "portolan";  ///< name in front of every line
  std::string level = "info";        ///< trace, debug, info, warn, error
  std::string file;                  ///< also written there when not empty
  int file_mb = 10;                  ///< size at which NAME.log becomes NAME.1.log, that one NAME.2.log and so on
  int files = 3;                     ///< kept of those; 0: the file is emptied and begun again
};

/// Sets up the process's log: standard error, and a rotating file if one is named. Fails on an unknown level or a file
/// that can't be opened. Log with spdlog::info("..."), warn, error, debug.
Status SetUpLog(const LogOptions& options);

/// Lets a repeated message through once a second at most and counts what it held back. Not thread-safe: one per call
/// site's owner.
class LogThrottle {
 public:
  /// @return whether to log now; if so, `suppressed()` tells how many were held back since the last one.
  bool Allow();
  uint64_t suppressed() const { return last_suppressed_; }

 private:
  std::chrono::steady_clock::time_point last_{};
  uint64_t held_ = 0;
  uint64_t last_suppressed_ = 0;
};

}  // namespace portolan
