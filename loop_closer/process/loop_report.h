#pragma once

#include <nlohmann/json.hpp>

#include "loop/loop_closer.h"

namespace portolan {

/// Adds what loop closing did to a process's report: "loops" (closed), "closures", "refusals" (the last ones, with
/// their reasons) and "loop_counters".
void AddLoops(const LoopCloser& closer, nlohmann::json* report);

}  // namespace portolan
