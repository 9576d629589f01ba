#include "processes/process_test.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>

namespace portolan {
namespace {

/// Domains that neither run.sh (up to 101) nor an operator is likely to choose.
constexpr int kFirstDomain = 102, kNumDomains = 99;

/// Whether nobody on this machine listens on the domain's discovery port (7400 + 250 x domain, DDSI-RTPS 2.2
/// Sec. 9.6.1.1).
bool IsDomainFree(int domain) {
  const int probe = socket(AF_INET, SOCK_DGRAM, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<uint16_t>(7400 + 250 * domain));
  const bool is_free = bind(probe, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
  close(probe);
  return is_free;
}

int NextDomain() {
  static int next = static_cast<int>(getpid());
  for (int tries = 0; tries < kNumDomains; ++tries) {
    const int domain = kFirstDomain + next++ % kNumDomains;
    if (IsDomainFree(domain)) return domain;
  }
  return kFirstDomain;
}

std::string BinFolder() {
  const char* named = std::getenv("PORTOLAN_BIN");
  return named != nullptr ? named : PORTOLAN_INSTALLED_BIN;
}

}  // namespace

ProcessTest::ProcessTest() : domain_(NextDomain()) {}

std::string ProcessTest::Program(const std::string& name) {
  return BinFolder() + "/" + name;
}

std::string ProcessTest::Sequence(const std::string& name) {
  return std::string(PORTOLAN_TEST_SEQUENCES) + "/" + name;
}

uint64_t ProcessTest::NumFrames() {
  return PORTOLAN_TEST_FRAMES;
}

std::vector<std::string> ProcessTest::RunCommand(const std::vector<std::string>& arguments) const {
  std::vector<std::string> command = {Program("../share/portolan/launch_scripts/run.sh"),
                                      "--bin",
                                      BinFolder(),
                                      "--out",
                                      Out(),
                                      "--domain",
                                      std::to_string(domain_)};
  command.insert(command.end(), arguments.begin(), arguments.end());
  return command;
}

std::unique_ptr<ChildProcess> ProcessTest::Start(const std::vector<std::string>& command) {
  return std::make_unique<ChildProcess>(command, folder_.Path("output_" + std::to_string(num_started_++) + ".txt"));
}

Ended ProcessTest::WaitForEnd(ChildProcess* process) const {
  const std::optional<int> code = process->Wait(kProcessDeadline);
  return {code.value_or(-1), process->Output(), process->StandardOutput()};
}

Ended ProcessTest::RunToEnd(const std::vector<std::string>& command) {
  return WaitForEnd(Start(command).get());
}

std::string ProcessTest::CopyOfSequence() const {
  const std::string copy = folder_.Path("sequence");
  std::filesystem::copy(Sequence(), copy, std::filesystem::copy_options::recursive);
  return copy;
}

std::string ProcessTest::InPieces(const std::string& parts) {
  const std::string folder = folder_.Path("pieces");
  const Ended made = RunToEnd({"/usr/bin/python3", PORTOLAN_MAKE_SEQUENCE, Sequence(), folder, "--parts", parts});
  EXPECT_EQ(made.code, 0) << made.output;
  return folder;
}

std::string ProcessTest::InRounds(int rounds) {
  std::string parts;
  for (int i = 0; i < rounds; ++i) parts += (i == 0 ? "" : ",") + std::string("0-60,59-1");
  return InPieces(parts);
}

std::string ProcessTest::Logs() const {
  std::string logs;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder_.path())) {
    const std::string suffix = entry.path().extension();
    if (suffix == ".log" || suffix == ".out")
      logs += "--- " + entry.path().string() + "\n" + ReadWholeFile(entry.path());
  }
  return logs;
}

std::string RealTimeSpeed(double factor) {
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
  factor /= 5;
#endif
  std::ostringstream text;
  text << factor;
  return text.str();
}

std::string ReadWholeFile(const std::string& path) {
  std::ostringstream text;
  text << std::ifstream(path, std::ios::binary).rdbuf();
  return text.str();
}

nlohmann::json ReadReport(const std::string& path) {
  nlohmann::json report = nlohmann::json::parse(ReadWholeFile(path), nullptr, false);
  EXPECT_TRUE(report.is_object()) << path;
  return report.is_object() ? report : nlohmann::json::object();
}

}  // namespace portolan
