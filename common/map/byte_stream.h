#pragma once

#include <cstdint>
#include <cstring>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>

namespace portolan {

static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "the store's files are little-endian");

/// Appends values to a string of bytes: fixed sizes as they are in memory, integers also as LEB128 (seven bits a byte,
/// lowest first).
class ByteWriter {
 public:
  template <class T>
  void Fixed(T value) {
    static_assert(std::is_arithmetic_v<T>);
    bytes_.append(reinterpret_cast<const char*>(&value), sizeof value);
  }
  template <class T>
  void FixedArray(const T* values, size_t count) {
    if (count > 0) bytes_.append(reinterpret_cast<const char*>(values), count * sizeof(T));
  }
  void Varint(uint64_t value) {
    for (; value >= 0x80; value >>= 7) bytes_.push_back(static_cast<char>(value | 0x80));
    bytes_.push_back(static_cast<char>(value));
  }
  /// The step from the value before, modulo 2^64, small steps in both directions short (zigzag): what is sorted takes a
  /// byte or two each.
  void Step(uint64_t value, uint64_t before) {
    const uint64_t step = value - before;
    Varint(step << 1 ^ (0 - (step >> 63)));
  }

  const std::string& bytes() const { return bytes_; }
  std::string Take() { return std::move(bytes_); }

 private:
  std::string bytes_;
};

/// Reads what ByteWriter wrote. After the first value that is not there everything reads as zero and ok() is false.
class ByteReader {
 public:
  explicit ByteReader(std::string_view bytes) : left_(bytes) {}

  template <class T>
  T Fixed() {
    T value{};
    FixedArray(&value, 1);
    return value;
  }
  template <class T>
  void FixedArray(T* values, size_t count) {
    if (left_.size() / sizeof(T) < count) return Fail();
    if (count > 0) std::memcpy(static_cast<void*>(values), left_.data(), count * sizeof(T));
    left_.remove_prefix(count * sizeof(T));
  }
  uint64_t Varint() {
    uint64_t value = 0;
    for (int shift = 0; shift < 64 && !left_.empty(); shift += 7) {
      const auto byte = static_cast<uint8_t>(left_.front());
      left_.remove_prefix(1);
      if (shift == 63 && byte > 1) break;  // does not fit into 64 bits
      value |= uint64_t{byte & 0x7fu} << shift;
      if (byte < 0x80) return value;
    }
    Fail();
    return 0;
  }
  uint64_t Step(uint64_t before) {
    const uint64_t zigzag = Varint();
    return before + (zigzag >> 1 ^ (0 - (zigzag & 1)));
  }
  /// A number of elements that take at least `min_bytes` each: more than the rest can hold is a failure, before
  /// anything is allocated.
  size_t Count(size_t min_bytes) {
    const uint64_t count = Varint();
    if (count <= left_.size() / min_bytes) return static_cast<size_t>(count);
    Fail();
    return 0;
  }

  bool ok() const { return ok_; }
  bool AtEnd() const { return ok_ && left_.empty(); }

 private:
  void Fail() {
    ok_ = false;
    left_ = {};
  }

  std::string_view left_;
  bool ok_ = true;
};

}  // namespace portolan
