#pragma once

#include <spdlog/spdlog.h>

#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <utility>

#include "base/log.h"

namespace portolan {

/// A DDS library's own messages, in the process's log instead of on standard output, which belongs to the program's
/// results. Each place of the library's source is heard once a second at most. Thread-safe.
class VendorLog {
 public:
  /// Into the log as it is set up now. It holds on to it: a library may have a last word after main().
  explicit VendorLog(std::string vendor) : vendor_(std::move(vendor)), log_(spdlog::default_logger()) {}

  /// @param file, line where in the library's source. @param text one message; white space at its end is dropped.
  void Write(spdlog::level::level_enum level, const std::string& file, int line, std::string text);

 private:
  const std::string vendor_;
  const std::shared_ptr<spdlog::logger> log_;
  std::mutex mutex_;
  std::map<std::pair<std::string, int>, LogThrottle> places_;
};

/// From now on, all that the library says in this process goes into the log as it is set up now.
void TakeFastDdsLog();
void TakeCycloneDdsLog();

}  // namespace portolan
