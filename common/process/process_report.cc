#include "process/process_report.h"

#include <sys/resource.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <iterator>

#include "base/atomic_file.h"
#include "version/version.h"

namespace portolan {

ResourceUse MeasureResources() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  const auto seconds = [](const timeval& t) {
    return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
  };
  long pages = 0, resident_pages = 0;
  std::ifstream("/proc/self/statm") >> pages >> resident_pages;
  std::error_code none;
  const auto files = std::distance(std::filesystem::directory_iterator("/proc/self/fd", none), {});
  ResourceUse use;
  use.peak_memory_mb = static_cast<double>(usage.ru_maxrss) * 1024e-6;
  use.resident_bytes = static_cast<double>(resident_pages) * static_cast<double>(getpagesize());
  use.open_files = static_cast<double>(files - 1);  // less the one that counting takes
  use.cpu_s = seconds(usage.ru_utime) + seconds(usage.ru_stime);
  return use;
}

nlohmann::json SummarizeTimes(const std::vector<double>& milliseconds) {
  return {
      {"median", Quantile(milliseconds, 0.5)}, {"p95", Quantile(milliseconds, 0.95)}, {"count", milliseconds.size()}};
}

nlohmann::json MakeReport(const ProcessOptions& options, const std::string& priority, const StageTimes& times,
                          const Bus& bus) {
  const ResourceUse resources = MeasureResources();
  nlohmann::json report = {{"role", options.role},
                           {"build", BuildDescription()},
                           {"dds", ToString(options.bus.vendor)},
                           {"priority", priority},
                           {"peak_memory_mb", resources.peak_memory_mb},
                           {"cpu_s", resources.cpu_s},
                           {"stages_ms", nlohmann::json::object()},
                           {"bytes_sent", nlohmann::json::object()},
                           {"bytes_received", nlohmann::json::object()},
                           {"counters", nlohmann::json::object()}};
  for (const auto& [stage, samples] : times.samples()) report["stages_ms"][stage] = SummarizeTimes(samples);
  for (const auto& [topic, counters] : bus.Counters()) {
    if (counters.sent_bytes > 0) report["bytes_sent"][topic] = counters.sent_bytes;
    if (counters.received_bytes > 0) report["bytes_received"][topic] = counters.received_bytes;
    nlohmann::json& counted = report["counters"][topic];
    counted = {{"sent", counters.sent},
               {"received", counters.received},
               {"malformed", counters.malformed},
               {"send_failures", counters.send_failures},
               {"lost", counters.lost}};
  }
  return report;
}

Status WriteReport(const ProcessOptions& options, const nlohmann::json& report) {
  if (options.out.empty()) return Ok{};
  const std::string path = options.out + "/" + options.role + ".json";
  return WriteFileAtomically(path, report.dump(2) + "\n");
}

}  // namespace portolan
