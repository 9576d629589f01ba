// What an operator does with an installation: moves it, and watches it with Prometheus.

#include <arpa/inet.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <regex>

#include "processes/deployment.h"

namespace portolan {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::StartsWith;

enum : int { kOk = 0, kFailure = 1, kBadInput = 2 };  // docs/tool.md

class OperationsTest : public DeploymentTest {
 protected:
  std::vector<std::string> Metrics(const std::vector<std::string>& arguments) const {
    std::vector<std::string> command = {Program("portolan"), "--domain", std::to_string(domain_), "metrics"};
    command.insert(command.end(), arguments.begin(), arguments.end());
    return command;
  }
  /// Waits until a condition holds of what a question gives.
  template <class Question, class Condition>
  static std::string AskUntil(const Question& question, const Condition& condition) {
    const auto deadline = std::chrono::steady_clock::now() + kProcessDeadline;
    std::string answer = question();
    while (!condition(answer) && std::chrono::steady_clock::now() < deadline) {
      usleep(50'000);
      answer = question();
    }
    return answer;
  }
};

std::string Get(int port, const std::string& path) {
  const int connection = socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<uint16_t>(port));
  inet_pton(AF_INET, "127.0.0.1", &address.sin_addr);
  std::string answer;
  const std::string request = "GET " + path + " HTTP/1.1\r\nHost: here\r\nConnection: close\r\n\r\n";
  if (connect(connection, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0 &&
      send(connection, request.data(), request.size(), MSG_NOSIGNAL) == static_cast<ssize_t>(request.size())) {
    char part[4096];
    for (ssize_t n = 0; (n = recv(connection, part, sizeof part, 0)) > 0;) answer.append(part, static_cast<size_t>(n));
  }
  close(connection);
  return answer;
}

bool HasAtlasServer(const std::string& text) {
  return text.find("portolan_processes{role=\"atlas_server\"} 1\n") != std::string::npos;
}

TEST_F(OperationsTest, MetricsOverHttpAndInAFile) {
  StartRole("atlas_server");
  const std::string file = folder_.Path("portolan.prom");
  const auto metrics = Start(Metrics({"--listen", "127.0.0.1:0", "--file", file}));
  std::smatch port;
  const std::string said =
      AskUntil([&] { return metrics->Output(); },
               [](const std::string& text) { return text.find("/metrics\n") != std::string::npos; });
  ASSERT_TRUE(std::regex_search(said, port, std::regex("on port ([0-9]+) under /metrics"))) << said;
  const std::string answer = AskUntil([&] { return Get(std::stoi(port[1]), "/metrics"); }, HasAtlasServer);
  EXPECT_THAT(answer, AllOf(StartsWith("HTTP/1.1 200"), HasSubstr("Content-Type: text/plain; version=0.0.4")));
  EXPECT_TRUE(HasAtlasServer(answer)) << answer << Logs();
  EXPECT_THAT(answer, AllOf(HasSubstr("# TYPE portolan_resident_memory_bytes gauge\n"),
                            HasSubstr("# TYPE portolan_cpu_seconds_total counter\n"),
                            HasSubstr("portolan_open_file_descriptors{role=\"atlas_server\"")));
  EXPECT_TRUE(HasAtlasServer(AskUntil([&] { return ReadWholeFile(file); }, HasAtlasServer)));
  // Who is gone is told of too.
  Kill("atlas_server");
  const auto is_down = [](const std::string& text) {
    return text.find("portolan_processes{role=\"atlas_server\"} 0\n") != std::string::npos;
  };
  EXPECT_TRUE(is_down(AskUntil([&] { return ReadWholeFile(file); }, is_down)));
}

TEST_F(OperationsTest, MetricsThatCanNotBeServedAreToldAtOnce) {
  for (const char* listen : {"70000", "here", "127.0.0.1:x"}) {
    const Ended ended = RunToEnd(Metrics({"--listen", listen}));
    EXPECT_EQ(ended.code, kBadInput) << ended.output;
    EXPECT_THAT(ended.output, HasSubstr(std::string("--listen '") + listen + "'"));
  }
  const Ended ended = RunToEnd(Metrics({"--file", folder_.Path("no/such/folder.prom")}));
  EXPECT_EQ(ended.code, kFailure) << ended.output;
  EXPECT_THAT(ended.output, HasSubstr("no/such"));
}

TEST_F(OperationsTest, AnInstallationWorksWhereverItIsCopied) {
  namespace fs = std::filesystem;
  const fs::path installed = fs::path(Program("portolan")).parent_path().parent_path();
  const fs::path copy = folder_.Path("elsewhere/portolan");
  fs::create_directories(copy);
  for (const char* part : {"bin", "lib/portolan", "share/portolan"}) {
    fs::create_directories((copy / part).parent_path());
    fs::copy(installed / part, copy / part, fs::copy_options::recursive | fs::copy_options::copy_symlinks);
  }
  // Nothing may come from where it was built: what is found is what the copy has.
  unsetenv("PORTOLAN_VOCABULARY");
  const Ended run = RunToEnd({copy / "share/portolan/launch_scripts/run.sh", "--data", Sequence(), "--out", Out(),
                              "--speed", "lockstep", "--domain", std::to_string(domain_)});
  ASSERT_EQ(run.code, kOk) << run.output << Logs();
  EXPECT_GT(Report("summary").value("tracked", 0u), NumFrames() * 8 / 10);
  EXPECT_THAT(Report("summary").value("command", ""), HasSubstr("run.sh"));
  EXPECT_THAT(Logs(), ::testing::Not(HasSubstr(installed.string() + "/")));
}

}  // namespace
}  // namespace portolan
