#pragma once

#include <map>
#include <nlohmann/json.hpp>
#include <string>

#include "base/result.h"
#include "base/statistics.h"
#include "process/process_setup.h"
#include "transport/bus.h"

namespace portolan {

/// What the operating system says of this process.
struct ResourceUse {
  double peak_memory_mb = 0;  ///< largest resident set, 1e6 bytes
  double resident_bytes = 0;  ///< resident set now
  double open_files = 0;      ///< descriptors
  double cpu_s = 0;           ///< user and system time of all threads
};
ResourceUse MeasureResources();

/// {"median": ..., "p95": ..., "count": ...} of a stage's milliseconds.
nlohmann::json SummarizeTimes(const std::vector<double>& milliseconds);

/// The part of a process's report that all roles share: role, build, dds, priority, peak_memory_mb, cpu_s, stages_ms,
/// bytes_sent, counters.
nlohmann::json MakeReport(const ProcessOptions& options, const std::string& priority, const StageTimes& times,
                          const Bus& bus);

/// Writes OUT/<role>.json, whole or not at all; nothing without an output folder. The launcher merges the reports into
/// summary.json.
Status WriteReport(const ProcessOptions& options, const nlohmann::json& report);

}  // namespace portolan
