#pragma once

#include <string>

#include "atlas/map_store.h"

namespace portolan {

/// The maps of a file: a map file (map/map_file.h) or the store of another atlas, with its map graph, told by their
/// first bytes. A store of an older schema is brought to the newest. Fails, naming the file, when it is neither, can't
/// be read, is in use, or has no map; maps of a store that are damaged are left out and named in `problems`.
Result<MapStore::Content> ReadMapsOf(const std::string& path);

}  // namespace portolan
