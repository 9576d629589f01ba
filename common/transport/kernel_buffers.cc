#include "transport/kernel_buffers.h"

#include <fstream>

#include "transport/raw_bus.h"

namespace portolan {

std::vector<std::string> CheckKernelBuffers(const std::string& folder) {
  std::vector<std::string> warnings;
  for (const char* name : {"rmem_max", "wmem_max"}) {
    std::ifstream file(folder + "/" + name);
    long long bytes = 0;
    if (!(file >> bytes)) continue;  // a container without /proc/sys/net/core: nothing can be said or set
    if (bytes >= kSocketBufferBytes) continue;
    warnings.push_back(std::string("net.core.") + name + " is " + std::to_string(bytes) +
                       " bytes, too small for bursts of images and keyframes; set it with: sysctl -w net.core." + name +
                       "=" + std::to_string(kSocketBufferBytes));
  }
  return warnings;
}

std::vector<std::string> CheckKernelBuffers() {
  return CheckKernelBuffers("/proc/sys/net/core");
}

}  // namespace portolan
