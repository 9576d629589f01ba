#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "base/result.h"
#include "map/keyframe.h"
#include "map/map.h"
#include "map/map_delta.h"

namespace portolan {

/// A map as it is stored: its state from revision 0, and the data of its keyframes (without derived fields).
struct StoredMap {
  MapDelta snapshot;
  std::vector<KeyFrameData> keyframes;
};

// A file of single maps, to carry them from atlas to atlas: blocks of map_io.h, each after its length of 8 bytes; the
// data of a map's keyframes first, then its state, then the next map. Each block has its own hash.

/// @param find_data gives the whole data of each keyframe of the maps, or why it can't. Whole or not at all, as
/// WriteFileAtomically.
Status WriteMapFile(const std::string& path, const std::vector<const Map*>& maps,
                    const std::function<Result<KeyFrameData>(const KeyFrame&)>& find_data);
/// Of maps that hold their keyframes' data whole.
Status WriteMapFile(const std::string& path, const std::vector<const Map*>& maps);

/// Fails naming the file and what is wrong with it: no map file, cut short, damaged, a map without its keyframes, none.
Result<std::vector<StoredMap>> ReadMapFile(const std::string& path);

/// Puts a map together. @param vocabulary may be null: no words. Fails when the parts make no valid map.
Result<Map> RestoreMap(const StoredMap& stored, const Vocabulary* vocabulary);

}  // namespace portolan
