#include <spdlog/spdlog.h>

#include <cstdio>
#include <memory>
#include <string>
#include <utility>

#include "base/atomic_file.h"
#include "process/metrics_server.h"
#include "process/tool_commands.h"
#include "tool/metrics.h"

namespace portolan {
namespace {

/// Only this machine: figures are for everybody there, and nobody else without the operator's word.
constexpr const char* kDefaultListen = "127.0.0.1:9470";
constexpr double kRefreshS = 1.0;
constexpr double kFirstS = 2.5;  // to hear who is there: a process publishes its status each second

}  // namespace

Status ServeMetrics(ToolSession* session, const ToolArguments& arguments) {
  std::unique_ptr<MetricsServer> server;
  if (!arguments.listen.empty() || arguments.metrics_file.empty()) {
    auto started = MetricsServer::Start(arguments.listen.empty() ? kDefaultListen : arguments.listen);
    if (!started) return session->Fail(kExitBadInput, started.error().message);
    server = std::move(*started);
    std::printf("portolan: figures on port %d under /metrics\n", server->port());
    std::fflush(stdout);
  }
  bool is_written = false;  // once: the path is good, and what fails later may pass
  for (double listen_s = kFirstS;; listen_s = kRefreshS) {
    session->Listen(listen_s, [] { return false; });
    const std::string text = FormatMetrics(session->book(), ToolSession::Now());
    if (server) server->Set(text);
    if (arguments.metrics_file.empty()) continue;
    const Status written = WriteFileAtomically(arguments.metrics_file, text);
    if (!written && !is_written) return session->Fail(kExitFailure, written.error().message);
    if (!written) spdlog::error("{}", written.error().message);
    is_written = true;
  }
}

}  // namespace portolan
