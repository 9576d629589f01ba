#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <type_traits>

namespace portolan {

/// A running 64-bit hash (FNV-1a with a final mix) for files, maps and vocabularies: equal on every machine of one byte
/// order.
class Hasher {
 public:
  void AddBytes(const void* data, size_t size);
  template <class T>
  void Add(const T& value) {
    static_assert(std::is_arithmetic_v<T> || std::is_enum_v<T>);
    AddBytes(&value, sizeof value);
  }
  uint64_t Value() const;

 private:
  uint64_t state_ = 0xcbf29ce484222325ull;
};

/// Sixteen hex digits.
std::string FormatHash(uint64_t hash);

}  // namespace portolan
