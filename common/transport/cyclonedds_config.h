#pragma once

#include <string>
#include <vector>

#include "transport/bus.h"

namespace portolan {

/// Cyclone DDS's configuration for these options, as XML, followed by what the user set in CYCLONEDDS_URI, which
/// overrides it.
/// @param user_uri value of CYCLONEDDS_URI, empty if unset.
std::string CycloneDdsConfig(const BusOptions& options, const std::vector<std::string>& peers,
                             const std::string& user_uri);

}  // namespace portolan
