#pragma once

#include <dds/dds.h>

#include <memory>
#include <optional>
#include <string>

#include "base/result.h"
#include "transport/credentials.h"
#include "transport/topic_qos.h"

namespace portolan {

struct CycloneDdsQosDeleter {
  void operator()(dds_qos_t* qos) const { dds_delete_qos(qos); }
};
using CycloneDdsQos = std::unique_ptr<dds_qos_t, CycloneDdsQosDeleter>;

/// Of a participant, with DDS Security if there are credentials. Fails when the plugins that come with the library are
/// not beside it.
Result<CycloneDdsQos> MakeCycloneDdsParticipantQos(const std::optional<Credentials>& credentials);
CycloneDdsQos MakeCycloneDdsWriterQos(const TopicQos& qos);
CycloneDdsQos MakeCycloneDdsReaderQos(const TopicQos& qos);
/// Of a publisher or subscriber. @param partition empty: none.
CycloneDdsQos MakeCycloneDdsGroupQos(const std::string& partition);

}  // namespace portolan
