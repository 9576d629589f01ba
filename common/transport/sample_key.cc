#include <algorithm>

#include "messages/wire_codec.h"
#include "transport/raw_bus.h"

namespace portolan {

SampleKey KeyOfSample(const uint8_t* data, size_t size) {
  SampleKey key;
  if (size < kEncapsulationBytes + SampleKey::kBytes) return key;
  std::copy_n(data + kEncapsulationBytes, SampleKey::kBytes, key.bytes);
  const bool little_endian = data[1] == 1;  // CDR_LE
  if (little_endian) std::reverse(key.bytes, key.bytes + SampleKey::kBytes);
  return key;
}

}  // namespace portolan
