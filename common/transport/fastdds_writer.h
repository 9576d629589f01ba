#pragma once

#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/DataWriterListener.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/topic/Topic.hpp>
#include <memory>
#include <string>

#include "transport/raw_bus.h"

namespace portolan {

class FastDdsWriter final : public RawWriter, private eprosima::fastdds::dds::DataWriterListener {
 public:
  static Result<std::unique_ptr<RawWriter>> Create(eprosima::fastdds::dds::Publisher* publisher,
                                                   eprosima::fastdds::dds::Topic* topic, const TopicQos& qos);
  ~FastDdsWriter() override;

  Status Write(SampleBytes sample) override;
  int MatchedReaders() const override;
  void AssertLiveliness() override;
  bool WaitForAcknowledgments(double seconds) override;

 private:
  explicit FastDdsWriter(eprosima::fastdds::dds::Publisher* publisher) : publisher_(publisher) {}
  void on_offered_incompatible_qos(eprosima::fastdds::dds::DataWriter* writer,
                                   const eprosima::fastdds::dds::OfferedIncompatibleQosStatus& status) override;

  eprosima::fastdds::dds::Publisher* const publisher_;
  eprosima::fastdds::dds::DataWriter* writer_ = nullptr;
};

}  // namespace portolan
