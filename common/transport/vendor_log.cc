#include "transport/vendor_log.h"

#include <dds/dds.h>
#include <dds/ddsrt/log.h>

#include <fastdds/dds/log/Log.hpp>

namespace portolan {
namespace {

namespace fastdds = eprosima::fastdds::dds;

class FastDdsLogConsumer final : public fastdds::LogConsumer {
 public:
  void Consume(const fastdds::Log::Entry& entry) override {
    const auto level = entry.kind == fastdds::Log::Error     ? spdlog::level::err
                       : entry.kind == fastdds::Log::Warning ? spdlog::level::warn
                                                             : spdlog::level::info;
    const fastdds::Log::Context& context = entry.context;
    log_.Write(level, context.filename != nullptr ? context.filename : "", context.line, entry.message);
  }

 private:
  VendorLog log_{"Fast DDS"};
};

void WriteCycloneDdsMessage(void* log, const dds_log_data_t* message) {
  const auto level = (message->priority & (DDS_LC_FATAL | DDS_LC_ERROR)) != 0 ? spdlog::level::err
                     : (message->priority & DDS_LC_WARNING) != 0              ? spdlog::level::warn
                                                                              : spdlog::level::info;
  // `size` and `message` are without the header (time and thread) that the library's own files have.
  static_cast<VendorLog*>(log)->Write(level, message->file, static_cast<int>(message->line),
                                      std::string(message->message, message->size));
}

}  // namespace

void VendorLog::Write(spdlog::level::level_enum level, const std::string& file, int line, std::string text) {
  text.erase(text.find_last_not_of(" \r\n") + 1);
  std::lock_guard<std::mutex> lock(mutex_);
  LogThrottle& throttle = places_[{file, line}];
  if (!throttle.Allow()) return;
  const uint64_t held = throttle.suppressed();
  log_->log(level, "{}: {}{}", vendor_, text, held == 0 ? "" : fmt::format(" (and {} more of these)", held));
}

void TakeFastDdsLog() {
  fastdds::Log::ClearConsumers();
  fastdds::Log::RegisterConsumer(std::make_unique<FastDdsLogConsumer>());
}

void TakeCycloneDdsLog() {
  static std::mutex mutex;
  static std::unique_ptr<VendorLog> taken;
  std::lock_guard<std::mutex> lock(mutex);
  auto log = std::make_unique<VendorLog>("Cyclone DDS");
  dds_set_log_sink(WriteCycloneDdsMessage, log.get());  // on return the one before is in nobody's use
  taken = std::move(log);
}

}  // namespace portolan
