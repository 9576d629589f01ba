#include "transport/fastdds_sample.h"

#include <fastdds/rtps/common/InstanceHandle.h>
#include <fastdds/rtps/common/SerializedPayload.h>
#include <algorithm>
#include <cstring>

namespace portolan {
namespace {

/// Bytes that Fast DDS takes for a sample before it knows its size; it takes more as needed.
constexpr uint32_t kFirstSampleBytes = 1024;

SampleBytes* AsSample(void* data) {
  return static_cast<SampleBytes*>(data);
}

}  // namespace

FastDdsSampleType::FastDdsSampleType(const std::string& name, bool keyed) {
  setName(name.c_str());
  m_typeSize = kFirstSampleBytes;
  m_isGetKeyDefined = keyed;
  auto_fill_type_object(false);
  auto_fill_type_information(false);
}

bool FastDdsSampleType::serialize(void* data, eprosima::fastrtps::rtps::SerializedPayload_t* payload) {
  const SampleBytes& sample = *AsSample(data);
  if (sample.size() > payload->max_size) return false;
  std::memcpy(payload->data, sample.data(), sample.size());
  payload->length = static_cast<uint32_t>(sample.size());
  payload->encapsulation = sample.size() > 1 && sample[1] == CDR_BE ? CDR_BE : CDR_LE;
  return true;
}

bool FastDdsSampleType::deserialize(eprosima::fastrtps::rtps::SerializedPayload_t* payload, void* data) {
  AsSample(data)->assign(payload->data, payload->data + payload->length);
  return true;
}

std::function<uint32_t()> FastDdsSampleType::getSerializedSizeProvider(void* data) {
  return [data] { return static_cast<uint32_t>(AsSample(data)->size()); };
}

void* FastDdsSampleType::createData() {
  return new SampleBytes;
}

void FastDdsSampleType::deleteData(void* data) {
  delete AsSample(data);
}

bool FastDdsSampleType::getKey(void* data, eprosima::fastrtps::rtps::InstanceHandle_t* handle, bool /*force_md5*/) {
  const SampleKey key = KeyOfSample(AsSample(data)->data(), AsSample(data)->size());
  for (size_t i = 0; i < 16; ++i) handle->value[i] = i < SampleKey::kBytes ? key.bytes[i] : 0;
  return true;
}

}  // namespace portolan
