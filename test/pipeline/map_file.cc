#include "pipeline/map_file.h"

#include <utility>

#include "map/map_file.h"

namespace portolan {

Result<std::map<MapId, Map>> LoadMaps(const std::string& path, const Vocabulary& vocabulary) {
  const auto stored = ReadMapFile(path);
  if (!stored) return stored.error();
  std::map<MapId, Map> maps;
  for (const StoredMap& one : *stored) {
    Result<Map> map = RestoreMap(one, &vocabulary);
    if (!map) return Error{path + ": " + map.error().message};
    const MapId id = map->id();
    maps.emplace(id, std::move(*map));
  }
  return maps;
}

}  // namespace portolan
