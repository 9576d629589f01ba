#include "base/ids.h"

#include <fmt/format.h>

#include <random>

namespace portolan {

std::string FormatId(uint64_t value) {
  if (value == 0) return "none";
  const Id<void> id(value);
  return fmt::format("{}.{:06x}.{}", id.robot(), id.session(), id.sequence());
}

uint32_t DrawSession() {
  std::random_device device;
  return std::uniform_int_distribution<uint32_t>(1, 0xffffffu)(device);
}

}  // namespace portolan
