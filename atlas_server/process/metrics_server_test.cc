#include "process/metrics_server.h"

#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <unistd.h>

namespace portolan {
namespace {

using ::testing::EndsWith;
using ::testing::HasSubstr;
using ::testing::StartsWith;

std::unique_ptr<MetricsServer> StartServer(const std::string& listen = "127.0.0.1:0") {
  auto server = MetricsServer::Start(listen);
  EXPECT_TRUE(server.ok()) << (server.ok() ? "" : server.error().message);
  return server.ok() ? std::move(server).value() : nullptr;
}

/// Sends bytes and reads all that comes back.
std::string Ask(int port, const std::string& request) {
  const int connection = socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<uint16_t>(port));
  inet_pton(AF_INET, "127.0.0.1", &address.sin_addr);
  EXPECT_EQ(connect(connection, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  EXPECT_EQ(send(connection, request.data(), request.size(), MSG_NOSIGNAL), static_cast<ssize_t>(request.size()));
  std::string answer;
  char part[4096];
  for (ssize_t n = 0; (n = recv(connection, part, sizeof part, 0)) > 0;) answer.append(part, static_cast<size_t>(n));
  close(connection);
  return answer;
}

std::string Get(int port, const std::string& path) {
  return Ask(port, "GET " + path + " HTTP/1.1\r\nHost: here\r\nConnection: close\r\n\r\n");
}

TEST(MetricsServerTest, ServesTheNewestText) {
  const auto server = StartServer();
  ASSERT_TRUE(server);
  EXPECT_THAT(Get(server->port(), "/metrics"), StartsWith("HTTP/1.1 503 "));
  server->Set("old 1\n");
  server->Set("new 2\n");
  const std::string answer = Get(server->port(), "/metrics");
  EXPECT_THAT(answer, StartsWith("HTTP/1.1 200 "));
  EXPECT_THAT(answer, HasSubstr("Content-Type: text/plain; version=0.0.4"));
  EXPECT_THAT(answer, EndsWith("\r\n\r\nnew 2\n"));
}

TEST(MetricsServerTest, OtherPathsAndMethodsAreRefused) {
  const auto server = StartServer();
  ASSERT_TRUE(server);
  server->Set("a 1\n");
  for (const char* path : {"/", "/metrics/more", "/../etc/passwd"}) {
    EXPECT_THAT(Get(server->port(), path), testing::Not(HasSubstr("200 OK"))) << path;
    EXPECT_THAT(Get(server->port(), path), testing::Not(HasSubstr("a 1"))) << path;
  }
  EXPECT_THAT(Ask(server->port(), "POST /metrics HTTP/1.1\r\nHost: here\r\nContent-Length: 0\r\n\r\n"),
              StartsWith("HTTP/1.1 405 "));
  EXPECT_THAT(Ask(server->port(), "HEAD /metrics HTTP/1.1\r\nHost: here\r\n\r\n"), EndsWith("\r\n\r\n"));
}

TEST(MetricsServerTest, ABrokenRequestHarmsNobody) {
  const auto server = StartServer();
  ASSERT_TRUE(server);
  server->Set("a 1\n");
  Ask(server->port(), std::string("\x00\xff\x16\x03\r\n\r\n", 8));
  EXPECT_THAT(Get(server->port(), "/metrics"), EndsWith("a 1\n"));
}

TEST(MetricsServerTest, ABadAddressIsNamed) {
  for (const char* listen :
       {"", "port", "70000", "127.0.0.1:", "127.0.0.1:-1", "9470,9471", "9470s", "some.host:9470"}) {
    const auto server = MetricsServer::Start(listen);
    ASSERT_FALSE(server.ok()) << listen;
    EXPECT_THAT(server.error().message, HasSubstr(std::string("--listen '") + listen + "'"));
  }
}

TEST(MetricsServerTest, AnAddressThatIsTakenIsNamed) {
  const auto first = StartServer();
  ASSERT_TRUE(first);
  const std::string listen = "127.0.0.1:" + std::to_string(first->port());
  const auto second = MetricsServer::Start(listen);
  ASSERT_FALSE(second.ok());
  EXPECT_THAT(second.error().message, HasSubstr(listen));
}

}  // namespace
}  // namespace portolan
