#include "transport/cyclonedds_qos.h"

namespace portolan {
namespace {

/// The policies that writers and readers share.
CycloneDdsQos MakeCommon(const TopicQos& qos) {
  CycloneDdsQos made(dds_create_qos());
  dds_qset_reliability(made.get(), qos.reliable ? DDS_RELIABILITY_RELIABLE : DDS_RELIABILITY_BEST_EFFORT,
                       DDS_MSECS(qos.max_blocking_ms));
  dds_qset_durability(made.get(), qos.transient_local ? DDS_DURABILITY_TRANSIENT_LOCAL : DDS_DURABILITY_VOLATILE);
  dds_qset_history(made.get(), qos.keep_all ? DDS_HISTORY_KEEP_ALL : DDS_HISTORY_KEEP_LAST, qos.depth);
  dds_qset_resource_limits(made.get(), qos.max_samples, DDS_LENGTH_UNLIMITED, DDS_LENGTH_UNLIMITED);
  if (qos.liveliness_lease_ms > 0) {
    dds_qset_liveliness(made.get(), DDS_LIVELINESS_MANUAL_BY_TOPIC, DDS_MSECS(qos.liveliness_lease_ms));
  }
  return made;
}

}  // namespace

CycloneDdsQos MakeCycloneDdsWriterQos(const TopicQos& qos) {
  CycloneDdsQos made = MakeCommon(qos);
  if (qos.transient_local) {
    dds_qset_durability_service(made.get(), 0, qos.keep_all ? DDS_HISTORY_KEEP_ALL : DDS_HISTORY_KEEP_LAST, qos.depth,
                                qos.max_samples, DDS_LENGTH_UNLIMITED, DDS_LENGTH_UNLIMITED);
  }
  dds_qset_writer_data_lifecycle(made.get(), false);  // a writer that ends takes nothing back
  return made;
}

CycloneDdsQos MakeCycloneDdsReaderQos(const TopicQos& qos) {
  return MakeCommon(qos);
}

CycloneDdsQos MakeCycloneDdsGroupQos(const std::string& partition) {
  CycloneDdsQos made(dds_create_qos());
  if (!partition.empty()) dds_qset_partition1(made.get(), partition.c_str());
  return made;
}

}  // namespace portolan
