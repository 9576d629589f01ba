#include "messages/wire_codec.h"

namespace portolan {

Status CheckEncapsulation(const uint8_t* data, size_t size) {
  if (size < kEncapsulationBytes)
    return Error{"sample of " + std::to_string(size) + " bytes has no encapsulation header"};
  if (data[0] != 0 || data[1] > 1) {
    return Error{"encapsulation " + std::to_string(data[0] * 256 + data[1]) + ", 0 or 1 (plain CDR) expected"};
  }
  return Ok{};
}

}  // namespace portolan
