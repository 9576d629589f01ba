#pragma once

#include <map>
#include <string>
#include <vector>

#include "base/result.h"
#include "map/map.h"
#include "vocabulary/vocabulary.h"

namespace portolan {

/// Writes maps with their keyframes' data into one file (map_io.h's blocks, each after its length of 8 bytes), for work
/// on what comes after mapping without mapping again.
Status SaveMaps(const std::string& path, const std::vector<const Map*>& maps);

/// Reads it back, with words of `vocabulary`. Fails naming the file and what is wrong with it.
Result<std::map<MapId, Map>> LoadMaps(const std::string& path, const Vocabulary& vocabulary);

}  // namespace portolan
