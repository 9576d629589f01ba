#include "transport/cyclonedds_writer.h"

#include <spdlog/spdlog.h>

#include "transport/cyclonedds_qos.h"
#include "transport/cyclonedds_sertype.h"

namespace portolan {
namespace {

struct ListenerDeleter {
  void operator()(dds_listener_t* listener) const { dds_delete_listener(listener); }
};

}  // namespace

Result<std::unique_ptr<RawWriter>> CycloneDdsWriter::Create(dds_entity_t publisher, dds_entity_t made_topic,
                                                            const ddsi_sertype* type, const RawTopic& topic) {
  std::unique_ptr<CycloneDdsWriter> writer(new CycloneDdsWriter(topic.name, type));
  const std::unique_ptr<dds_listener_t, ListenerDeleter> listener(dds_create_listener(writer.get()));
  dds_lset_offered_incompatible_qos(listener.get(), LogIncompatibleQos);
  writer->writer_ = dds_create_writer(publisher, made_topic, MakeCycloneDdsWriterQos(topic.qos).get(), listener.get());
  if (writer->writer_ < 0) return Error{std::string("Cyclone DDS made no writer: ") + dds_strretcode(writer->writer_)};
  return std::unique_ptr<RawWriter>(std::move(writer));
}

CycloneDdsWriter::~CycloneDdsWriter() {
  if (writer_ > 0) dds_delete(writer_);
}

void CycloneDdsWriter::LogIncompatibleQos(dds_entity_t /*writer*/, const dds_offered_incompatible_qos_status_t status,
                                          void* self) {
  if (status.last_policy_id == DDS_PARTITION_QOS_POLICY_ID) return;  // another robot's, as it should be
  spdlog::warn("{}: a reader asks for another quality of service (policy {}): not matched",
               static_cast<CycloneDdsWriter*>(self)->name_, status.last_policy_id);
}

Status CycloneDdsWriter::Write(SampleBytes sample) {
  ddsi_serdata* data = MakeCycloneDdsSample(type_, std::move(sample));
  if (data == nullptr) return Error{"Cyclone DDS: out of memory"};
  const dds_return_t written = dds_writecdr(writer_, data);  // takes the reference over
  if (written != DDS_RETCODE_OK) return Error{std::string("Cyclone DDS: ") + dds_strretcode(written)};
  return Ok{};
}

int CycloneDdsWriter::MatchedReaders() const {
  dds_publication_matched_status_t status;
  if (dds_get_publication_matched_status(writer_, &status) != DDS_RETCODE_OK) return 0;
  return static_cast<int>(status.current_count);
}

void CycloneDdsWriter::AssertLiveliness() {
  dds_assert_liveliness(writer_);
}

bool CycloneDdsWriter::WaitForAcknowledgments(double seconds) {
  return dds_wait_for_acks(writer_, static_cast<dds_duration_t>(seconds * 1e9)) == DDS_RETCODE_OK;
}

}  // namespace portolan
