#pragma once

#include <fastcdr/Cdr.h>
#include <fastcdr/FastBuffer.h>

#include <cstdint>
#include <exception>
#include <string>
#include <vector>

#include "base/result.h"

namespace portolan {

/// Bytes of the encapsulation header in front of every sample.
constexpr size_t kEncapsulationBytes = 4;

/// Fails unless the sample is plain CDR of either byte order (RTPS 2.2, Sec. 10.2: 0x0000 and 0x0001).
Status CheckEncapsulation(const uint8_t* data, size_t size);

/// Serialises a generated type, header included.
template <class Wire>
std::vector<uint8_t> EncodeSample(const Wire& wire) {
  namespace cdr = eprosima::fastcdr;
  std::vector<uint8_t> bytes(kEncapsulationBytes + Wire::getCdrSerializedSize(wire));
  cdr::FastBuffer buffer(reinterpret_cast<char*>(bytes.data()), bytes.size());
  cdr::Cdr stream(buffer, cdr::Cdr::DEFAULT_ENDIAN, cdr::Cdr::DDS_CDR);
  stream.serialize_encapsulation();
  wire.serialize(stream);
  bytes.resize(stream.getSerializedDataLength());
  return bytes;
}

/// Reads a generated type from what the network delivered: any bytes at all. Fast CDR throws for what is cut short;
/// lengths that exceed the sample are refused before memory is taken for them.
template <class Wire>
Result<Wire> DecodeSample(const uint8_t* data, size_t size) {
  namespace cdr = eprosima::fastcdr;
  const Status encapsulation = CheckEncapsulation(data, size);
  if (!encapsulation.ok()) return encapsulation.error();
  try {
    cdr::FastBuffer buffer(const_cast<char*>(reinterpret_cast<const char*>(data)), size);  // only read
    cdr::Cdr stream(buffer, cdr::Cdr::DEFAULT_ENDIAN, cdr::Cdr::DDS_CDR);
    stream.read_encapsulation();
    Wire wire;
    wire.deserialize(stream);
    return wire;
  } catch (const std::exception& exception) {
    return Error{std::string("can't be deserialised: ") + exception.what()};
  }
}

}  // namespace portolan
