#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "loop/loop_journal.h"

namespace portolan {

/// Adds what loop closing did to a process's report: "loops" (closed), "closures", "refusals" (of candidates that were
/// verified, the last ones) and "loop_counters".
void AddLoops(const LoopJournal& journal, nlohmann::json* report);

/// The same in short, for process_status.
std::vector<std::pair<std::string, double>> LoopFigures(const LoopJournal& journal);

}  // namespace portolan
