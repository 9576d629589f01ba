#pragma once

#include <cstdint>
#include <functional>
#include <ostream>
#include <string>

namespace portolan {

/// Number of a robot in a deployment, 0 to 65535; set by --robot.
using RobotId = uint16_t;

/// Identity of something that one process creates and others refer to. Unique without a central counter: the creator's
/// robot (16 bit), its session (24 bit, drawn anew at each start of a process) and a sequence within it (24 bit, from
/// 1). Never reused. Value 0 is "none". Ordered by robot, session, sequence, so ids of one session sort by age.
template <class Tag>
struct Id {
  uint64_t value = 0;

  constexpr Id() = default;
  constexpr explicit Id(uint64_t v) : value(v) {}
  constexpr Id(RobotId robot, uint32_t session, uint32_t sequence)
      : value(uint64_t{robot} << 48 | uint64_t{session & 0xffffffu} << 24 | (sequence & 0xffffffu)) {}

  constexpr bool IsValid() const { return value != 0; }
  constexpr RobotId robot() const { return static_cast<RobotId>(value >> 48); }
  constexpr uint32_t session() const { return static_cast<uint32_t>(value >> 24) & 0xffffffu; }
  constexpr uint32_t sequence() const { return static_cast<uint32_t>(value) & 0xffffffu; }

  friend constexpr bool operator==(Id a, Id b) { return a.value == b.value; }
  friend constexpr bool operator!=(Id a, Id b) { return a.value != b.value; }
  friend constexpr bool operator<(Id a, Id b) { return a.value < b.value; }
};

using KeyFrameId = Id<struct KeyFrameTag>;
using MapPointId = Id<struct MapPointTag>;
using MapId = Id<struct MapTag>;
using ProcessId = Id<struct ProcessTag>;
using RequestId = Id<struct RequestTag>;

/// "robot.session.sequence" with the session in hex, as in "0.3fa21c.17"; "none" for an id of value 0.
std::string FormatId(uint64_t value);

template <class Tag>
std::string ToString(Id<Tag> id) {
  return FormatId(id.value);
}

template <class Tag>
std::ostream& operator<<(std::ostream& out, Id<Tag> id) {
  return out << FormatId(id.value);
}

/// Draws a session number at random from the operating system: 1 to 2^24 - 1.
uint32_t DrawSession();

/// Mints ids for one process. When the 24-bit sequence is used up it goes on in a new session. Not thread-safe.
template <class IdType>
class IdMinter {
 public:
  IdMinter(RobotId robot, uint32_t session) : robot_(robot), session_(session) {}

  IdType Next() {
    if (++sequence_ > 0xffffffu) {
      session_ = DrawSession();
      sequence_ = 1;
    }
    return IdType(robot_, session_, sequence_);
  }

 private:
  RobotId robot_;
  uint32_t session_;
  uint32_t sequence_ = 0;
};

}  // namespace portolan

template <class Tag>
struct std::hash<portolan::Id<Tag>> {
  size_t operator()(portolan::Id<Tag> id) const noexcept {
    uint64_t x = id.value * 0x9e3779b97f4a7c15ull;  // Fibonacci hashing: neighbouring sequences spread over the table
    return static_cast<size_t>(x ^ (x >> 32));
  }
};
