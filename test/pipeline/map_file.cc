#include "pipeline/map_file.h"

#include <cstring>
#include <fstream>
#include <memory>
#include <string_view>

#include "base/atomic_file.h"
#include "map/map_io.h"

namespace portolan {
namespace {

void Append(const std::string& block, std::string* bytes) {
  const uint64_t size = block.size();
  bytes->append(reinterpret_cast<const char*>(&size), sizeof(size));
  bytes->append(block);
}

/// Takes a block off the front; empty when there is none.
std::string_view TakeBlock(std::string_view* bytes) {
  uint64_t size = 0;
  if (bytes->size() < sizeof(size)) return {};
  std::memcpy(&size, bytes->data(), sizeof(size));
  bytes->remove_prefix(sizeof(size));
  const std::string_view block = bytes->substr(0, size);
  bytes->remove_prefix(block.size());
  return block;
}

/// Applies a snapshot to a new map.
Result<Map> MakeMap(std::string_view block, const std::map<KeyFrameId, std::shared_ptr<const KeyFrameData>>& keyframes) {
  const Result<MapDelta> snapshot = DecodeSnapshot(block);
  if (!snapshot) return snapshot.error();
  Map map(snapshot->map, snapshot->epoch);
  const Status applied = map.Apply(*snapshot, [&](KeyFrameId id) {
    const auto found = keyframes.find(id);
    return found == keyframes.end() ? nullptr : found->second;
  });
  if (!applied) return applied.error();
  return map;
}

}  // namespace

Status SaveMaps(const std::string& path, const std::vector<const Map*>& maps) {
  std::string bytes;
  for (const Map* map : maps) {
    for (const auto& [id, keyframe] : map->keyframes()) Append(EncodeKeyFrameData(*keyframe.data), &bytes);
    Append(EncodeSnapshot(map->Snapshot()), &bytes);
  }
  return WriteFileAtomically(path, bytes);
}

Result<std::map<MapId, Map>> LoadMaps(const std::string& path, const Vocabulary& vocabulary) {
  std::ifstream file(path, std::ios::binary);
  const std::string content((std::istreambuf_iterator<char>(file)), std::istreambuf_iterator<char>());
  if (!file) return Error{path + ": can't be read"};
  std::map<KeyFrameId, std::shared_ptr<const KeyFrameData>> keyframes;
  std::map<MapId, Map> maps;
  for (std::string_view bytes = content; !bytes.empty();) {
    const std::string_view block = TakeBlock(&bytes);
    if (block.substr(0, 4) == "PKFD") {
      Result<KeyFrameData> data = DecodeKeyFrameData(block);
      if (!data) return Error{path + ": " + data.error().message};
      const KeyFrameId id = data->id;
      keyframes[id] = MakeKeyFrameData(std::move(*data), &vocabulary);
      continue;
    }
    Result<Map> map = MakeMap(block, keyframes);
    if (!map) return Error{path + ": " + map.error().message};
    const MapId id = map->id();
    maps.emplace(id, std::move(*map));
  }
  return maps;
}

}  // namespace portolan
