#include <arpa/inet.h>
#include <netdb.h>

#include <algorithm>
#include <chrono>
#include <cstring>

#include "transport/raw_bus.h"

namespace portolan {
namespace {

/// RTPS takes 7400 + 250 * domain as a base port; beyond 230 the ports of several participants would pass 65535.
constexpr int kMaxDomain = 230;
constexpr size_t kMaxPartitionBytes = 128;
constexpr size_t kMaxHostNameBytes = 253;  // RFC 1035
constexpr const char* kThisHost = "127.0.0.1";

bool OnlyHas(const std::string& text, const char* others) {
  return std::all_of(text.begin(), text.end(), [others](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
           (c != '\0' && std::strchr(others, c) != nullptr);
  });
}

/// The first IPv4 address of a host, in numbers.
Result<std::string> ResolvePeer(const std::string& host) {
  addrinfo hints{};
  hints.ai_family = AF_INET;
  hints.ai_socktype = SOCK_DGRAM;
  addrinfo* found = nullptr;
  const int failure = getaddrinfo(host.c_str(), nullptr, &hints, &found);
  if (failure != 0) return Error{"dds.peers: " + host + " can't be resolved: " + gai_strerror(failure)};
  char text[INET_ADDRSTRLEN] = {};
  inet_ntop(AF_INET, &reinterpret_cast<const sockaddr_in*>(found->ai_addr)->sin_addr, text, sizeof text);
  freeaddrinfo(found);
  return std::string(text);
}

Result<std::optional<Credentials>> OpenCredentials(const BusOptions& options) {
  if (options.credentials_folder.empty()) return std::optional<Credentials>();
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  const int64_t now_s = std::chrono::duration_cast<std::chrono::seconds>(now).count();
  Result<Credentials> credentials = Credentials::Open(options.credentials_folder, now_s);
  if (!credentials.ok()) return credentials.error();
  if (Status permitted = credentials->CheckPermitted(options.domain, options.partition); !permitted.ok())
    return permitted.error();
  return std::optional<Credentials>(*credentials);
}

}  // namespace

Result<DdsVendor> ParseDdsVendor(const std::string& name) {
  if (name == "fastdds") return DdsVendor::kFastDds;
  if (name == "cyclonedds") return DdsVendor::kCycloneDds;
  return Error{"DDS vendor '" + name + "' is unknown: fastdds or cyclonedds expected"};
}

std::string ToString(DdsVendor vendor) {
  return vendor == DdsVendor::kFastDds ? "fastdds" : "cyclonedds";
}

Status BusOptions::Check() const {
  if (domain < 0 || domain > kMaxDomain) {
    return Error{"dds.domain is " + std::to_string(domain) + ", 0 to " + std::to_string(kMaxDomain) + " expected"};
  }
  if (partition.empty() || partition.size() > kMaxPartitionBytes || !OnlyHas(partition, "_-.*?")) {
    return Error{"dds.partition is '" + partition + "', letters, digits, _ - . and the wildcards * ? expected"};
  }
  for (const std::string& peer : peers) {
    if (peer.empty() || peer.size() > kMaxHostNameBytes || !OnlyHas(peer, "-.")) {
      return Error{"dds.peers holds '" + peer + "', an IPv4 address or a host name expected"};
    }
  }
  if (image_topic.empty() || !OnlyHas(image_topic, "_/")) {
    return Error{"dds.image_topic is '" + image_topic + "', a name as rt/camera/image_raw expected"};
  }
  if (small_datagrams && !credentials_folder.empty() && vendor == DdsVendor::kFastDds) {
    return Error{
        "dds.small_datagrams and dds.security don't go together on Fast DDS, whose handshake does not fit into "
        "such datagrams: cyclonedds expected, or a link that carries larger ones"};
  }
  const Result<std::optional<Credentials>> credentials = OpenCredentials(*this);
  return credentials ? Status(Ok{}) : Status(credentials.error());
}

Result<std::unique_ptr<RawBus>> MakeRawBus(const BusOptions& options) {
  const Status checked = options.Check();
  if (!checked.ok()) return checked.error();
  BusSurroundings surroundings;
  for (const std::string& peer : options.peers) {
    Result<std::string> address = ResolvePeer(peer);
    if (!address.ok()) return address.error();
    surroundings.peers.push_back(*address);
  }
  // Processes of this machine don't find each other by multicast any more either, and users name the other machines.
  if (!surroundings.peers.empty()) surroundings.peers.push_back(kThisHost);
  Result<std::optional<Credentials>> credentials = OpenCredentials(options);
  if (!credentials.ok()) return credentials.error();
  surroundings.credentials = *credentials;
  return options.vendor == DdsVendor::kFastDds ? MakeFastDdsBus(options, surroundings)
                                               : MakeCycloneDdsBus(options, surroundings);
}

}  // namespace portolan
