#pragma once

#include <map>
#include <string>

#include "base/result.h"
#include "map/map.h"
#include "vocabulary/vocabulary.h"

namespace portolan {

/// Reads a file of maps (map/map_file.h), with words of `vocabulary`, for work on what comes after mapping without
/// mapping again. Fails naming the file and what is wrong with it.
Result<std::map<MapId, Map>> LoadMaps(const std::string& path, const Vocabulary& vocabulary);

}  // namespace portolan
