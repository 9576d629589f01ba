#pragma once

#include <dds/dds.h>

#include <memory>
#include <string>

#include "transport/raw_bus.h"

struct ddsi_sertype;

namespace portolan {

class CycloneDdsWriter final : public RawWriter {
 public:
  /// @param type made_topic's, as the library returned it.
  static Result<std::unique_ptr<RawWriter>> Create(dds_entity_t publisher, dds_entity_t made_topic,
                                                   const ddsi_sertype* type, const RawTopic& topic);
  ~CycloneDdsWriter() override;

  Status Write(SampleBytes sample) override;
  int MatchedReaders() const override;
  void AssertLiveliness() override;
  bool WaitForAcknowledgments(double seconds) override;

 private:
  CycloneDdsWriter(std::string name, const ddsi_sertype* type) : name_(std::move(name)), type_(type) {}
  static void LogIncompatibleQos(dds_entity_t writer, const dds_offered_incompatible_qos_status_t status, void* self);

  const std::string name_;
  const ddsi_sertype* const type_;
  dds_entity_t writer_ = 0;
};

}  // namespace portolan
