#include "map/map_file.h"

#include <cstring>
#include <filesystem>
#include <fstream>
#include <map>
#include <set>
#include <sstream>
#include <string_view>
#include <utility>

#include "base/atomic_file.h"
#include "map/map_io.h"

namespace portolan {
namespace {

constexpr std::string_view kKeyFrameMark = "PKFD";  // as map_io.cc writes them
constexpr std::string_view kSnapshotMark = "PMAP";
constexpr size_t kMarkBytes = 4;

void Append(const std::string& block, std::string* bytes) {
  const uint64_t size = block.size();
  bytes->append(reinterpret_cast<const char*>(&size), sizeof size);
  bytes->append(block);
}

/// Takes a block off the front. Fails on one that is longer than what is left.
Result<std::string_view> TakeBlock(std::string_view* bytes) {
  uint64_t size = 0;
  if (bytes->size() < sizeof size) return Error{"cut short"};
  std::memcpy(&size, bytes->data(), sizeof size);
  bytes->remove_prefix(sizeof size);
  if (size > bytes->size()) return Error{"cut short"};
  const std::string_view block = bytes->substr(0, size);
  bytes->remove_prefix(block.size());
  return block;
}

/// Whether the first block is one of a map file: what else the file may be is not looked at.
bool BeginsLikeAMapFile(std::string_view bytes) {
  if (bytes.size() < sizeof(uint64_t) + kMarkBytes) return false;
  const std::string_view mark = bytes.substr(sizeof(uint64_t), kMarkBytes);
  return mark == kKeyFrameMark || mark == kSnapshotMark;
}

/// That the data of exactly the map's keyframes is there.
Status CheckKeyFrames(const StoredMap& map) {
  std::set<KeyFrameId> missing;
  for (const auto& state : map.snapshot.keyframes) missing.insert(state.id);
  for (const KeyFrameData& data : map.keyframes) {
    if (missing.erase(data.id) == 0)
      return Error{"keyframe " + ToString(data.id) + " is not in the map, or there twice"};
  }
  if (missing.empty()) return Ok{};
  return Error{"the data of keyframe " + ToString(*missing.begin()) + " is missing"};
}

/// Reads one block into the map under way, and moves that on to `maps` when the block was its state, the last.
Status ReadBlock(std::string_view block, StoredMap* map, std::vector<StoredMap>* maps) {
  if (block.substr(0, kMarkBytes) == kKeyFrameMark) {
    Result<KeyFrameData> data = DecodeKeyFrameData(block);
    if (!data) return data.error();
    map->keyframes.push_back(std::move(*data));
    return Ok{};
  }
  Result<MapDelta> snapshot = DecodeSnapshot(block);
  if (!snapshot) return snapshot.error();
  map->snapshot = std::move(*snapshot);
  if (Status checked = CheckKeyFrames(*map); !checked)
    return Error{"map " + ToString(map->snapshot.map) + ": " + checked.error().message};
  maps->push_back(std::exchange(*map, {}));
  return Ok{};
}

Result<std::vector<StoredMap>> ReadBlocks(std::string_view bytes) {
  if (!BeginsLikeAMapFile(bytes)) return Error{"no map file"};
  std::vector<StoredMap> maps;
  StoredMap map;
  while (!bytes.empty()) {
    const Result<std::string_view> block = TakeBlock(&bytes);
    if (!block) return block.error();
    if (Status read = ReadBlock(*block, &map, &maps); !read) return read.error();
  }
  if (!map.keyframes.empty()) return Error{"cut short: the state of its last map is missing"};
  return maps;
}

}  // namespace

Status WriteMapFile(const std::string& path, const std::vector<const Map*>& maps,
                    const std::function<Result<KeyFrameData>(const KeyFrame&)>& find_data) {
  std::string bytes;
  for (const Map* map : maps) {
    for (const auto& [id, keyframe] : map->keyframes()) {
      const Result<KeyFrameData> data = find_data(keyframe);
      if (!data) return data.error();
      Append(EncodeKeyFrameData(*data), &bytes);
    }
    Append(EncodeSnapshot(map->Snapshot()), &bytes);
  }
  return WriteFileAtomically(path, bytes);
}

Status WriteMapFile(const std::string& path, const std::vector<const Map*>& maps) {
  return WriteMapFile(path, maps, [](const KeyFrame& keyframe) -> Result<KeyFrameData> { return *keyframe.data; });
}

Result<std::vector<StoredMap>> ReadMapFile(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  std::ostringstream content;
  content << file.rdbuf();
  if (!file.is_open() || file.bad() || std::filesystem::is_directory(path))
    return Error{"map file '" + path + "': can't be read"};
  Result<std::vector<StoredMap>> maps = ReadBlocks(content.str());
  if (!maps) return Error{"map file '" + path + "': " + maps.error().message};
  return maps;
}

Result<Map> RestoreMap(const StoredMap& stored, const Vocabulary* vocabulary) {
  std::map<KeyFrameId, std::shared_ptr<const KeyFrameData>> keyframes;
  for (const KeyFrameData& data : stored.keyframes) keyframes[data.id] = MakeKeyFrameData(data, vocabulary);
  Map map(stored.snapshot.map, stored.snapshot.epoch);
  const Status applied = map.Apply(stored.snapshot, [&](KeyFrameId id) {
    const auto found = keyframes.find(id);
    return found == keyframes.end() ? nullptr : found->second;
  });
  if (!applied) return applied.error();
  return map;
}

}  // namespace portolan
