#pragma once

#include <string>
#include <vector>

namespace portolan {

/// CheckKernelBuffers() of bus.h, reading rmem_max and wmem_max in a folder other than /proc/sys/net/core.
std::vector<std::string> CheckKernelBuffers(const std::string& folder);

}  // namespace portolan
