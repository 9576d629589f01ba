#pragma once

#include <string>

#include "tool/status_book.h"

namespace portolan {

/// What the processes tell of themselves, as Prometheus's text format has it (version 0.0.4): HELP and TYPE of each
/// metric, then a line for each process. Names begin with portolan_ and end in their unit, or _total for counters.
std::string FormatMetrics(const StatusBook& book, double now_s);

/// Of the answer over HTTP.
constexpr const char* kMetricsContentType = "text/plain; version=0.0.4; charset=utf-8";

}  // namespace portolan
