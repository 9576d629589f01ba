#include "transport/cyclonedds_reader.h"

#include <spdlog/spdlog.h>

#include <array>

#include "transport/cyclonedds_qos.h"
#include "transport/cyclonedds_sertype.h"

namespace portolan {
namespace {

/// Samples taken at once; any number does.
constexpr size_t kBatch = 32;

constexpr uint32_t kStatuses = DDS_LIVELINESS_CHANGED_STATUS | DDS_SAMPLE_LOST_STATUS | DDS_SAMPLE_REJECTED_STATUS |
                               DDS_REQUESTED_INCOMPATIBLE_QOS_STATUS;

}  // namespace

Result<std::unique_ptr<Reader>> CycloneDdsReader::Create(dds_entity_t participant, dds_entity_t subscriber,
                                                         dds_entity_t made_topic, const RawTopic& topic,
                                                         RawReaderEvents events) {
  std::unique_ptr<CycloneDdsReader> reader(new CycloneDdsReader(topic, std::move(events)));
  const Status opened = reader->Open(participant, subscriber, made_topic, topic.qos);
  if (!opened.ok()) return opened.error();
  reader->thread_ = std::thread([self = reader.get()] { self->Run(); });
  return std::unique_ptr<Reader>(std::move(reader));
}

Status CycloneDdsReader::Open(dds_entity_t participant, dds_entity_t subscriber, dds_entity_t made_topic,
                              const TopicQos& qos) {
  reader_ = dds_create_reader(subscriber, made_topic, MakeCycloneDdsReaderQos(qos).get(), nullptr);
  if (reader_ < 0) return Error{std::string("Cyclone DDS made no reader: ") + dds_strretcode(reader_)};
  dds_set_status_mask(reader_, kStatuses);
  const dds_entity_t data = dds_create_readcondition(reader_, DDS_ANY_STATE);
  stop_ = dds_create_guardcondition(participant);
  wait_set_ = dds_create_waitset(participant);
  for (const dds_entity_t condition : {data, stop_, reader_}) {
    const dds_return_t attached = dds_waitset_attach(wait_set_, condition, condition);
    if (attached != DDS_RETCODE_OK)
      return Error{std::string("Cyclone DDS made no wait set: ") + dds_strretcode(attached)};
  }
  return Ok{};
}

CycloneDdsReader::~CycloneDdsReader() {
  if (thread_.joinable()) {
    stopping_ = true;
    dds_set_guardcondition(stop_, true);
    thread_.join();
  }
  for (const dds_entity_t entity : {wait_set_, stop_, reader_}) {
    if (entity > 0) dds_delete(entity);
  }
}

int CycloneDdsReader::MatchedWriters() const {
  dds_subscription_matched_status_t status;
  if (dds_get_subscription_matched_status(reader_, &status) != DDS_RETCODE_OK) return 0;
  return static_cast<int>(status.current_count);
}

int CycloneDdsReader::AliveWriters() const {
  return has_lease_ ? alive_writers_.load() : MatchedWriters();
}

void CycloneDdsReader::Run() {
  while (true) {
    dds_waitset_wait(wait_set_, nullptr, 0, DDS_INFINITY);
    if (stopping_) return;
    HandleStatuses();
    TakeSamples();
  }
}

void CycloneDdsReader::HandleStatuses() {
  dds_liveliness_changed_status_t liveliness;
  if (dds_get_liveliness_changed_status(reader_, &liveliness) == DDS_RETCODE_OK && has_lease_) {
    const int alive = static_cast<int>(liveliness.alive_count);
    if (alive_writers_.exchange(alive) != alive && events_.on_liveliness_changed) events_.on_liveliness_changed(alive);
  }
  dds_sample_lost_status_t lost{};
  dds_sample_rejected_status_t rejected{};
  dds_get_sample_lost_status(reader_, &lost);
  dds_get_sample_rejected_status(reader_, &rejected);
  const int gone = lost.total_count_change + rejected.total_count_change;
  if (gone > 0) events_.on_lost(static_cast<uint64_t>(gone));
  dds_requested_incompatible_qos_status_t incompatible{};
  dds_get_requested_incompatible_qos_status(reader_, &incompatible);
  if (incompatible.total_count_change > 0 &&
      incompatible.last_policy_id != DDS_PARTITION_QOS_POLICY_ID) {  // else another robot's
    spdlog::warn("{}: a writer offers another quality of service (policy {}): not matched", name_,
                 incompatible.last_policy_id);
  }
}

void CycloneDdsReader::TakeSamples() {
  std::array<ddsi_serdata*, kBatch> samples{};
  std::array<dds_sample_info_t, kBatch> infos{};
  while (!stopping_) {
    const dds_return_t count = dds_takecdr(reader_, samples.data(), kBatch, infos.data(), DDS_ANY_STATE);
    if (count <= 0) return;
    for (size_t i = 0; i < static_cast<size_t>(count); ++i) {
      const std::unique_ptr<ddsi_serdata, void (*)(ddsi_serdata*)> sample(samples[i], ddsi_serdata_unref);
      if (!infos[i].valid_data) continue;
      const SampleBytes& bytes = BytesOfCycloneDdsSample(sample.get());
      events_.on_sample(bytes.data(), bytes.size());
    }
  }
}

}  // namespace portolan
