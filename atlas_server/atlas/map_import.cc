#include "atlas/map_import.h"

#include <fstream>
#include <string_view>
#include <utility>

namespace portolan {
namespace {

constexpr std::string_view kSqliteMark = "SQLite format 3";  // https://sqlite.org/fileformat.html, Sec. 1.3

bool IsSqliteFile(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  std::string mark(kSqliteMark.size(), '\0');
  return file.read(mark.data(), static_cast<std::streamsize>(mark.size())) && mark == kSqliteMark;
}

}  // namespace

Result<MapStore::Content> ReadMapsOf(const std::string& path) {
  MapStore::Content content;
  if (IsSqliteFile(path)) {
    auto store = MapStore::Open(path);
    if (!store) return store.error();
    Result<MapStore::Content> loaded = (*store)->Load();
    if (!loaded) return loaded.error();
    content = std::move(*loaded);
  } else {
    auto maps = ReadMapFile(path);
    if (!maps) return maps.error();
    content.maps = std::move(*maps);
  }
  if (!content.maps.empty()) return content;
  return Error{content.problems.empty() ? "'" + path + "' holds no map" : content.problems.front()};
}

}  // namespace portolan
