#include "tool/atlas_check.h"

#include <filesystem>
#include <map>
#include <utility>

#include "atlas/map_store.h"
#include "map/map_file.h"

namespace portolan {
namespace {

/// @return the map's entry of the report; its problems are added to `problems`.
nlohmann::json CheckMap(const StoredMap& stored, std::map<MapId, Epoch>* epochs, nlohmann::json* problems) {
  const MapDelta& state = stored.snapshot;
  const std::string name = "map " + ToString(state.map) + ": ";
  nlohmann::json entry = {{"id", ToString(state.map)},
                          {"epoch", state.epoch},
                          {"revision", state.revision},
                          {"points", state.points.size()},
                          {"keyframes", nlohmann::json::array()}};
  for (const MapDelta::KeyFrameState& keyframe : state.keyframes) entry["keyframes"].push_back(ToString(keyframe.id));
  const Result<Map> map = RestoreMap(stored, nullptr);
  if (!map) problems->push_back(name + map.error().message);
  if (map) {
    for (const std::string& violation : ValidateMap(*map)) problems->push_back(name + violation);
  }
  const Epoch granted = (*epochs)[state.map];
  if (granted < state.epoch)
    problems->push_back(name + "is of epoch " + std::to_string(state.epoch) + ", but " + std::to_string(granted) +
                        " was the last that was granted");
  return entry;
}

}  // namespace

Result<AtlasCheck> CheckAtlas(const std::string& path) {
  if (!std::filesystem::is_regular_file(path)) return Error{"atlas store '" + path + "': no such file"};
  auto store = MapStore::Open(path);
  if (!store) return store.error();
  const Result<MapStore::Content> content = (*store)->Load();
  if (!content) return content.error();
  AtlasCheck check;
  nlohmann::json maps = nlohmann::json::array(), problems = content->problems;
  std::map<MapId, Epoch> epochs;
  for (const Atlas::Ownership& ownership : content->ownerships) epochs[ownership.map] = ownership.epoch;
  for (const StoredMap& map : content->maps) maps.push_back(CheckMap(map, &epochs, &problems));
  check.is_sound = problems.empty();
  check.report = {{"maps", std::move(maps)}, {"problems", std::move(problems)}};
  return check;
}

}  // namespace portolan
