#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "base/result.h"

namespace portolan {

/// What is in an atlas's store, and whether it is sound.
struct AtlasCheck {
  nlohmann::json report;  ///< "maps": [{"id", "epoch", "revision", "points", "keyframes": [ids]}], "problems": [text]
  bool is_sound = false;  ///< no problems
};

/// Reads the store at `path`, which no atlas_server may have open, and audits every map in it (ValidateMap). Fails when
/// there is no such file or it is no store.
Result<AtlasCheck> CheckAtlas(const std::string& path);

}  // namespace portolan
