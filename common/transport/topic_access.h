#pragma once

#include <array>
#include <cstdint>

namespace portolan {

/// What a participant is in a deployment, as far as permissions go. One or several, as a set of bits.
enum Role : uint32_t {
  kRoleTracker = 1 << 0,
  kRoleMapper = 1 << 1,
  kRoleLoop = 1 << 2,
  kRoleAtlas = 1 << 3,
  kRoleTool = 1 << 4,    ///< `portolan`, the operator's
  kRoleCamera = 1 << 5,  ///< portolan_play, or a camera's driver
};
using Roles = uint32_t;

/// Who may write a topic and who may read it. DDS Security holds them to it where it is on (permissions.h).
struct TopicAccess {
  Roles writers = 0;
  Roles readers = 0;
};

struct RoleName {
  Role role;
  const char* name;  ///< of the process, and of its folder of credentials
};
constexpr std::array<RoleName, 6> kRoleNames = {{{kRoleTracker, "frontend_tracker"},
                                                 {kRoleMapper, "backend_mapper"},
                                                 {kRoleLoop, "loop_closer"},
                                                 {kRoleAtlas, "atlas_server"},
                                                 {kRoleTool, "tool"},
                                                 {kRoleCamera, "camera"}}};

}  // namespace portolan
