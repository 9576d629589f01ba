#pragma once

#include <fastdds/dds/topic/TopicDataType.hpp>

#include "transport/raw_bus.h"

namespace portolan {

/// The "type support" that Fast DDS asks for: its samples are SampleBytes, already serialised.
class FastDdsSampleType final : public eprosima::fastdds::dds::TopicDataType {
 public:
  FastDdsSampleType(const std::string& name, bool keyed);

  bool serialize(void* data, eprosima::fastrtps::rtps::SerializedPayload_t* payload) override;
  bool deserialize(eprosima::fastrtps::rtps::SerializedPayload_t* payload, void* data) override;
  std::function<uint32_t()> getSerializedSizeProvider(void* data) override;
  void* createData() override;
  void deleteData(void* data) override;
  bool getKey(void* data, eprosima::fastrtps::rtps::InstanceHandle_t* handle, bool force_md5) override;
};

}  // namespace portolan
