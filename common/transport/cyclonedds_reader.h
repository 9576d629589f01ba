#pragma once

#include <dds/dds.h>

#include <atomic>
#include <memory>
#include <string>
#include <thread>

#include "transport/raw_bus.h"

namespace portolan {

/// A reader with a thread of its own, which sleeps in a wait set until there is something to do.
class CycloneDdsReader final : public Reader {
 public:
  static Result<std::unique_ptr<Reader>> Create(dds_entity_t participant, dds_entity_t subscriber,
                                                dds_entity_t made_topic, const RawTopic& topic, RawReaderEvents events);
  ~CycloneDdsReader() override;

  int MatchedWriters() const override;
  int AliveWriters() const override;

 private:
  CycloneDdsReader(const RawTopic& topic, RawReaderEvents events)
      : name_(topic.name), has_lease_(topic.qos.liveliness_lease_ms > 0), events_(std::move(events)) {}
  Status Open(dds_entity_t participant, dds_entity_t subscriber, dds_entity_t made_topic, const TopicQos& qos);
  void Run();
  void HandleStatuses();
  void TakeSamples();

  const std::string name_;
  const bool has_lease_;
  const RawReaderEvents events_;
  dds_entity_t reader_ = 0;
  dds_entity_t stop_ = 0;  // guard condition
  dds_entity_t wait_set_ = 0;
  std::atomic<bool> stopping_{false};
  std::atomic<int> alive_writers_{0};
  std::thread thread_;
};

}  // namespace portolan
