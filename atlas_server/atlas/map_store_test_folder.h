#pragma once

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "atlas/map_store.h"
#include "base/random.h"
#include "map/random_edits.h"

// What tests of the store share: a folder for its file, maps to be stored, and what is read back of them.

namespace portolan {

namespace fs = std::filesystem;

inline std::string MessageOf(const Status& status) {
  return status.ok() ? "" : status.error().message;
}

class MapStoreTest : public ::testing::Test {
 protected:
  MapStoreTest() {
    std::string name = fs::temp_directory_path() / "portolan_store_XXXXXX";
    folder_ = mkdtemp(name.data());
    path_ = folder_ / "atlas.db";
  }
  ~MapStoreTest() override { fs::remove_all(folder_); }

  static std::unique_ptr<MapStore> Open(const fs::path& path) {
    auto store = MapStore::Open(path);
    EXPECT_TRUE(store.ok()) << (store.ok() ? "" : store.error().message);
    return store.ok() ? std::move(*store) : nullptr;
  }
  static std::string OpenError(const fs::path& path) {
    const auto store = MapStore::Open(path);
    return store.ok() ? "" : store.error().message;
  }

  static std::vector<std::shared_ptr<const KeyFrameData>> DataOf(const Map& map) {
    std::vector<std::shared_ptr<const KeyFrameData>> data;
    for (const auto& [id, keyframe] : map.keyframes()) data.push_back(keyframe.data);
    return data;
  }
  /// Of all keyframes that ever were.
  static std::vector<std::shared_ptr<const KeyFrameData>> DataOf(const RandomEdits& edits) {
    std::vector<std::shared_ptr<const KeyFrameData>> data;
    for (const auto& [id, keyframe] : edits.data()) data.push_back(keyframe);
    return data;
  }
  static Status Save(MapStore* store, const Map& map) {
    Status saved = store->SaveKeyFrames(DataOf(map));
    return saved ? store->SaveMap(map.Snapshot()) : saved;
  }

  /// The map that a store holds, rebuilt.
  static uint64_t HashOf(const MapStore::StoredMap& stored) {
    std::map<KeyFrameId, std::shared_ptr<const KeyFrameData>> data;
    for (const KeyFrameData& keyframe : stored.keyframes) data[keyframe.id] = MakeKeyFrameData(keyframe, nullptr);
    Map map(stored.snapshot.map);
    const Status applied = map.Apply(stored.snapshot, [&](KeyFrameId id) { return data.at(id); });
    EXPECT_TRUE(applied.ok()) << MessageOf(applied);
    return HashMap(map);
  }
  static MapStore::Content Load(MapStore* store) {
    Result<MapStore::Content> content = store->Load();
    EXPECT_TRUE(content.ok()) << (content.ok() ? "" : content.error().message);
    return content.ok() ? std::move(*content) : MapStore::Content();
  }

  Map MakeMap(uint64_t seed, int edits = 100) {
    Map map(MapId(0, 1, static_cast<uint32_t>(seed)), seed);
    RandomEdits editor(seed, &map);
    for (int i = 0; i < edits; ++i) editor.Next();
    static_cast<void>(map.TakeDelta());
    return map;
  }

  fs::path folder_, path_;
};

}  // namespace portolan
