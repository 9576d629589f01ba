#pragma once

#include <string>

#include "base/config_reader.h"

namespace portolan {

struct AtlasOptions {
  std::string
      store;  ///< file of the atlas; empty: atlas.db in the output folder, if there is one; "none": nothing is stored
  double store_interval_s = 3;  ///< between two stored states of a map: what a crash of all processes costs at most,
                                ///< besides the keyframes themselves
};

/// Reads the section atlas.
Status ReadAtlasOptions(ConfigReader* config, AtlasOptions* options);

/// Where the store is, given the output folder (may be empty). Empty: nowhere.
std::string StorePath(const AtlasOptions& options, const std::string& out);

}  // namespace portolan
