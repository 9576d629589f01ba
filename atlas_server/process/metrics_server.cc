#include "process/metrics_server.h"

#include <civetweb.h>

#include <cstring>
#include <regex>
#include <utility>

#include "tool/metrics.h"

namespace portolan {
namespace {

constexpr const char* kNumThreads = "2";  // a scraper, and a person with a browser
constexpr int kMaxPort = 65535;

bool IsListenAddress(const std::string& listen) {
  static const std::regex form("(([0-9.]+|\\[[0-9a-fA-F:]+\\]):)?([0-9]{1,5})");
  std::smatch parts;
  return std::regex_match(listen, parts, form) && std::stoi(parts[3]) <= kMaxPort;
}

int Send(mg_connection* connection, int code, const char* type, const std::string& text) {
  mg_printf(connection, "HTTP/1.1 %d %s\r\nContent-Type: %s\r\nContent-Length: %zu\r\nConnection: close\r\n\r\n", code,
            mg_get_response_code_text(connection, code), type, text.size());
  if (std::strcmp(mg_get_request_info(connection)->request_method, "HEAD") != 0)
    mg_write(connection, text.data(), text.size());
  return code;
}

/// @return 0 for a method that reads, else the code that was sent.
int RefuseOthers(mg_connection* connection) {
  const char* method = mg_get_request_info(connection)->request_method;
  if (std::strcmp(method, "GET") == 0 || std::strcmp(method, "HEAD") == 0) return 0;
  return Send(connection, 405, "text/plain", "GET expected\n");
}

}  // namespace

Result<std::unique_ptr<MetricsServer>> MetricsServer::Start(const std::string& listen) {
  if (!IsListenAddress(listen))
    return Error{"--listen '" + listen + "': PORT or ADDRESS:PORT expected, in numbers, the port 0 to 65535"};
  std::unique_ptr<MetricsServer> server(new MetricsServer());
  const char* options[] = {"listening_ports", listen.c_str(), "num_threads", kNumThreads, nullptr};
  const mg_callbacks callbacks{};
  mg_init_data init{};
  init.callbacks = &callbacks;
  init.user_data = server.get();
  init.configuration_options = options;
  char reason[256] = "";
  mg_error_data error{};
  error.text = reason;
  error.text_buffer_size = sizeof reason;
  mg_init_library(0);
  server->context_ = mg_start2(&init, &error);
  if (server->context_ == nullptr) return Error{"--listen " + listen + ": " + reason};
  mg_set_request_handler(server->context_, "/metrics$", &MetricsServer::Answer, server.get());
  mg_set_request_handler(server->context_, "/", &MetricsServer::AnswerNotFound, server.get());
  return server;
}

MetricsServer::~MetricsServer() {
  if (context_ != nullptr) mg_stop(context_);
  mg_exit_library();
}

void MetricsServer::Set(std::string text) {
  std::lock_guard<std::mutex> lock(mutex_);
  text_ = std::move(text);
}

int MetricsServer::port() const {
  mg_server_port ports[1];
  return mg_get_server_ports(context_, 1, ports) == 1 ? ports[0].port : 0;
}

int MetricsServer::Answer(mg_connection* connection, void* server) {
  if (const int refused = RefuseOthers(connection)) return refused;
  auto* self = static_cast<MetricsServer*>(server);
  std::string text;
  {
    std::lock_guard<std::mutex> lock(self->mutex_);
    text = self->text_;
  }
  if (text.empty()) return Send(connection, 503, "text/plain", "no figures yet\n");
  return Send(connection, 200, kMetricsContentType, text);
}

int MetricsServer::AnswerNotFound(mg_connection* connection, void* /*server*/) {
  if (const int refused = RefuseOthers(connection)) return refused;
  return Send(connection, 404, "text/plain", "Portolan's figures are under /metrics\n");
}

}  // namespace portolan
