#pragma once

#include <string>

#include "base/result.h"

namespace portolan {

/// A share in a Cyclone DDS domain of this process. The library holds domains process-wide and deletes everything in
/// one when it is deleted: so the first share creates it and the last one deletes it. The configuration is the first
/// share's.
class CycloneDdsDomain {
 public:
  CycloneDdsDomain() = default;
  CycloneDdsDomain(const CycloneDdsDomain&) = delete;
  CycloneDdsDomain& operator=(const CycloneDdsDomain&) = delete;
  ~CycloneDdsDomain();

  /// Once. Fails with Cyclone's reason, a bad configuration for one.
  Status Join(int domain, const std::string& config);

 private:
  int domain_ = -1;
};

}  // namespace portolan
