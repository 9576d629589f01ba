#include "transport/fastdds_qos.h"

#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <fastrtps/utils/IPLocator.h>

#include <map>
#include <memory>
#include <string>

namespace portolan {
namespace {

namespace dds = eprosima::fastdds::dds;
namespace rtps = eprosima::fastrtps::rtps;

/// Size of datagrams under one MTU; above Cyclone's by about 100 bytes, because it is Fast DDS's receive buffer too.
constexpr uint32_t kSmallDatagramBytes = 1400;
/// Announcements in the first two seconds: matching takes seconds without them.
constexpr uint32_t kInitialAnnouncements = 20;
constexpr double kInitialAnnouncementPeriodS = 0.1;
/// Resending starts with a heartbeat: the default of 3 s is a long time for a keyframe.
constexpr double kHeartbeatPeriodS = 0.1;

dds::LivelinessQosPolicy Liveliness(const TopicQos& qos) {
  dds::LivelinessQosPolicy policy;
  if (qos.liveliness_lease_ms > 0) {
    policy.kind = dds::MANUAL_BY_TOPIC_LIVELINESS_QOS;
    policy.lease_duration = FastDdsDuration(qos.liveliness_lease_ms / 1e3);
    policy.announcement_period = FastDdsDuration(qos.liveliness_lease_ms / 3e3);
  }
  return policy;
}

/// The policies that writers and readers share.
template <class EndpointQos>
void SetCommon(const TopicQos& qos, EndpointQos* endpoint) {
  endpoint->reliability().kind = qos.reliable ? dds::RELIABLE_RELIABILITY_QOS : dds::BEST_EFFORT_RELIABILITY_QOS;
  endpoint->reliability().max_blocking_time = FastDdsDuration(qos.max_blocking_ms / 1e3);
  endpoint->durability().kind =
      qos.transient_local ? dds::TRANSIENT_LOCAL_DURABILITY_QOS : dds::VOLATILE_DURABILITY_QOS;
  endpoint->history().kind = qos.keep_all ? dds::KEEP_ALL_HISTORY_QOS : dds::KEEP_LAST_HISTORY_QOS;
  endpoint->history().depth = qos.depth;
  endpoint->resource_limits().max_samples = qos.max_samples;
  endpoint->resource_limits().max_instances = qos.max_samples;  // Fast DDS wants a bound on all three or none
  endpoint->resource_limits().max_samples_per_instance = qos.keep_all ? qos.max_samples : qos.depth;
  endpoint->resource_limits().allocated_samples = 1;
  endpoint->liveliness() = Liveliness(qos);
  // DYNAMIC_RESERVE would refuse a dispose and ask for it for ever.
  endpoint->endpoint().history_memory_policy = rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
  endpoint->data_sharing().off();
}

/// DDS Security's built-in plugins, with the properties of DDS-SECURITY 1.1, Sec. 9.
void SetSecurity(const Credentials& credentials, dds::DomainParticipantQos* qos) {
  const std::string authentication = "dds.sec.auth.builtin.PKI-DH.";
  const std::string access = "dds.sec.access.builtin.Access-Permissions.";
  for (const auto& [name, value] : std::map<std::string, std::string>{
           {"dds.sec.auth.plugin", "builtin.PKI-DH"},
           {"dds.sec.access.plugin", "builtin.Access-Permissions"},
           {"dds.sec.crypto.plugin", "builtin.AES-GCM-GMAC"},
           {authentication + "identity_ca", "file://" + credentials.identity_ca},
           {authentication + "identity_certificate", "file://" + credentials.certificate},
           {authentication + "private_key", "file://" + credentials.private_key},
           {access + "permissions_ca", "file://" + credentials.permissions_ca},
           {access + "governance", "file://" + credentials.governance},
           {access + "permissions", "file://" + credentials.permissions}}) {
    qos->properties().properties().emplace_back(name, value);
  }
}

}  // namespace

eprosima::fastrtps::Duration_t FastDdsDuration(double seconds) {
  return eprosima::fastrtps::Duration_t(static_cast<long double>(seconds));
}

dds::DomainParticipantQos FastDdsParticipantQos(const BusOptions& options, const BusSurroundings& surroundings) {
  dds::DomainParticipantQos qos;
  qos.name("portolan");
  // UDP alone: the default shared-memory segment is too small for keyframes and slow for what exceeds it.
  auto udp = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
  udp->sendBufferSize = kSocketBufferBytes;
  udp->receiveBufferSize = kSocketBufferBytes;
  udp->maxInitialPeersRange = kMaxParticipantsPerHost;
  if (options.small_datagrams) udp->maxMessageSize = kSmallDatagramBytes;
  qos.transport().use_builtin_transports = false;
  qos.transport().user_transports.push_back(udp);

  auto& builtin = qos.wire_protocol().builtin;
  builtin.discovery_config.leaseDuration = FastDdsDuration(kParticipantLeaseS);
  builtin.discovery_config.leaseDuration_announcementperiod = FastDdsDuration(kAnnouncementPeriodS);
  builtin.discovery_config.initial_announcements.count = kInitialAnnouncements;
  builtin.discovery_config.initial_announcements.period = FastDdsDuration(kInitialAnnouncementPeriodS);
  for (const std::string& peer : surroundings.peers) {
    rtps::Locator_t locator;
    rtps::IPLocator::setIPv4(locator, peer);
    builtin.initialPeersList.push_back(locator);
  }
  if (!surroundings.peers.empty())
    builtin.metatrafficUnicastLocatorList.push_back(rtps::Locator_t());  // any address, and no multicast
  if (surroundings.credentials) SetSecurity(*surroundings.credentials, &qos);
  return qos;
}

dds::DataWriterQos FastDdsWriterQos(const TopicQos& qos) {
  dds::DataWriterQos writer;
  SetCommon(qos, &writer);
  // Asynchronous publishing deadlocks in 2.9.1 when a reader leaves while samples wait to be sent: discovery and the
  // sending thread take the locks of writer and flow controller in opposite order
  // (github.com/eProsima/Fast-DDS/pull/3468). It also costs a change of threads, 15 ms on a loaded machine.
  writer.publish_mode().kind = dds::SYNCHRONOUS_PUBLISH_MODE;
  writer.reliable_writer_qos().times.heartbeatPeriod = FastDdsDuration(kHeartbeatPeriodS);
  return writer;
}

dds::DataReaderQos FastDdsReaderQos(const TopicQos& qos) {
  dds::DataReaderQos reader;
  SetCommon(qos, &reader);
  // An acknowledgement at once lets Cyclone's writers go on: 18 MB/s became 255.
  reader.reliable_reader_qos().times.heartbeatResponseDelay = FastDdsDuration(0);
  return reader;
}

}  // namespace portolan
