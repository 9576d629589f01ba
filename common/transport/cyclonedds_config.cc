#include "transport/cyclonedds_config.h"

#include <sstream>

#include "messages/limits.h"
#include "transport/raw_bus.h"

namespace portolan {
namespace {

/// Datagrams near UDP's limit, fewest to the sample; or under one MTU, about 100 bytes below Fast DDS's
/// (design/dds.md).
constexpr const char* kLargeDatagrams = "<MaxMessageSize>65500B</MaxMessageSize><FragmentSize>63000B</FragmentSize>";
constexpr const char* kSmallDatagrams = "<MaxMessageSize>1300B</MaxMessageSize><FragmentSize>1200B</FragmentSize>";
/// Unacknowledged bytes at which a writer begins to wait: the defaults throttle at a few samples of a keyframe's size.
constexpr const char* kWatermarks = "<WhcHigh>64MB</WhcHigh><WhcLow>1kB</WhcLow><WhcHighInit>8MB</WhcHighInit>";

}  // namespace

std::string CycloneDdsConfig(const BusOptions& options, const std::vector<std::string>& peers,
                             const std::string& user_uri) {
  std::ostringstream xml;
  xml << "<CycloneDDS><Domain Id=\"any\">";
  xml << "<General>" << (peers.empty() ? "" : "<AllowMulticast>false</AllowMulticast>")
      << (options.small_datagrams ? kSmallDatagrams : kLargeDatagrams) << "</General>";
  xml << "<Discovery><LeaseDuration>" << kParticipantLeaseS << "s</LeaseDuration><SPDPInterval>" << kAnnouncementPeriodS
      << "s</SPDPInterval>";
  if (!peers.empty()) {
    xml << "<ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>" << kMaxParticipantsPerHost
        << "</MaxAutoParticipantIndex><Peers>";
    for (const std::string& peer : peers) xml << "<Peer Address=\"" << peer << "\"/>";
    xml << "</Peers>";
  }
  xml << "</Discovery>";
  xml << "<Internal><SocketReceiveBufferSize min=\"default\" max=\"" << kSocketBufferBytes
      << "B\"/><SocketSendBufferSize min=\"default\" max=\"" << kSocketBufferBytes << "B\"/><MaxSampleSize>"
      << kMaxSampleBytes << "B</MaxSampleSize><Watermarks>" << kWatermarks << "</Watermarks></Internal>";
  xml << "</Domain></CycloneDDS>";
  return user_uri.empty() ? xml.str() : xml.str() + "," + user_uri;
}

}  // namespace portolan
