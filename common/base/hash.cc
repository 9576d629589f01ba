#include "base/hash.h"

#include <fmt/format.h>

#include <cstring>

namespace portolan {

void Hasher::AddBytes(const void* data, size_t size) {
  // FNV-1a over 8-byte words, then the tail byte by byte: one multiplication a word keeps a 4 MB vocabulary at a few
  // ms.
  constexpr uint64_t kPrime = 0x100000001b3ull;
  const auto* bytes = static_cast<const unsigned char*>(data);
  for (; size >= 8; size -= 8, bytes += 8) {
    uint64_t word;
    std::memcpy(&word, bytes, 8);
    state_ = (state_ ^ word) * kPrime;
    state_ ^= state_ >> 29;
  }
  for (; size > 0; --size, ++bytes) state_ = (state_ ^ *bytes) * kPrime;
}

uint64_t Hasher::Value() const {
  uint64_t z = state_;
  z = (z ^ (z >> 33)) * 0xff51afd7ed558ccdull;
  z = (z ^ (z >> 33)) * 0xc4ceb9fe1a85ec53ull;
  return z ^ (z >> 33);
}

std::string FormatHash(uint64_t hash) {
  return fmt::format("{:016x}", hash);
}

}  // namespace portolan
