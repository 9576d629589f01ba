#include "transport/cyclonedds_domain.h"

#include <dds/dds.h>

#include <map>
#include <mutex>

namespace portolan {
namespace {

struct Shares {
  dds_entity_t handle = 0;
  int count = 0;
};

/// Mirrors what is process-wide in the library itself.
struct Registry {
  std::mutex mutex;
  std::map<int, Shares> domains;
};

Registry& GetRegistry() {
  static Registry registry;
  return registry;
}

}  // namespace

Status CycloneDdsDomain::Join(int domain, const std::string& config) {
  Registry& registry = GetRegistry();
  std::lock_guard<std::mutex> lock(registry.mutex);
  Shares& shares = registry.domains[domain];
  if (shares.count == 0) {
    shares.handle = dds_create_domain(static_cast<dds_domainid_t>(domain), config.c_str());
    if (shares.handle < 0) {
      return Error{"Cyclone DDS made no domain " + std::to_string(domain) + ": " + dds_strretcode(shares.handle)};
    }
  }
  ++shares.count;
  domain_ = domain;
  return Ok{};
}

CycloneDdsDomain::~CycloneDdsDomain() {
  if (domain_ < 0) return;
  Registry& registry = GetRegistry();
  std::lock_guard<std::mutex> lock(registry.mutex);
  Shares& shares = registry.domains[domain_];
  if (--shares.count == 0) dds_delete(shares.handle);
}

}  // namespace portolan
