#pragma once

#include <memory>
#include <mutex>
#include <string>

#include "base/result.h"

struct mg_connection;
struct mg_context;

namespace portolan {

/// Serves the newest text under http://ADDRESS:PORT/metrics, to Prometheus for one. Thread-safe.
class MetricsServer {
 public:
  /// @param listen PORT, ADDRESS:PORT or [ADDRESS]:PORT for IPv6; port 0: one that is free.
  /// Fails on what is no such thing, and when nobody may listen there or somebody does.
  static Result<std::unique_ptr<MetricsServer>> Start(const std::string& listen);
  ~MetricsServer();
  MetricsServer(const MetricsServer&) = delete;
  MetricsServer& operator=(const MetricsServer&) = delete;

  /// Until the first time it answers that there is nothing yet.
  void Set(std::string text);
  int port() const;

 private:
  MetricsServer() = default;
  static int Answer(mg_connection* connection, void* server);
  static int AnswerNotFound(mg_connection* connection, void* server);

  std::mutex mutex_;
  std::string text_;
  mg_context* context_ = nullptr;
};

}  // namespace portolan
