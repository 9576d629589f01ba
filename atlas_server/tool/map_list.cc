#include "tool/map_list.h"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <set>
#include <utility>

#include "tool/map_names.h"
#include "tool/text_columns.h"

namespace portolan {
namespace {

using nlohmann::json;

/// Thrown and caught within this file, as nlohmann's own exceptions are.
template <class IdType>
IdType ReadId(const json& entry, const char* key, bool needed) {
  const std::string text = needed ? entry.at(key).get<std::string>() : entry.value(key, std::string("none"));
  const auto id = ParseIdAs<IdType>(text);
  if (!id) throw std::invalid_argument(fmt::format("'{}' of \"{}\" is no id", text, key));
  return *id;
}

template <size_t n>
Eigen::Matrix<double, n, 1> ReadVector(const json& list) {
  const auto values = list.get<std::array<double, n>>();
  return Eigen::Map<const Eigen::Matrix<double, n, 1>>(values.data());
}

Sim3d ReadSimilarity(const json& entry) {
  Sim3d similarity;
  similarity.scale = entry.at("scale").get<double>();
  similarity.rotation = Eigen::Quaterniond(ReadVector<4>(entry.at("rotation")));
  similarity.translation = ReadVector<3>(entry.at("translation"));
  return similarity;
}

/// Runs a parser on a text, and turns what it throws into an error.
template <class T>
Result<T> Parse(const std::string& text, const char* what, void (*read)(const json&, T*)) {
  T value;
  try {
    read(json::parse(text), &value);
  } catch (const std::exception& error) {
    return Error{fmt::format("the atlas_server's {} can't be read: {}", what, error.what())};
  }
  return value;
}

void ReadMapList(const json& text, MapList* list) {
  for (const json& map : text.at("maps")) {
    MapList::Entry entry;
    entry.map = ReadId<MapId>(map, "map", true);
    entry.robot = map.value("robot", RobotId{0});
    entry.epoch = map.value("epoch", Epoch{0});
    entry.owner = ReadId<ProcessId>(map, "owner", false);
    entry.owner_alive = map.value("owner_alive", false);
    entry.is_active = map.value("active", false);
    entry.state_epoch = map.value("state_epoch", Epoch{0});
    entry.revision = map.value("revision", Revision{0});
    entry.keyframes = map.value("keyframes", size_t{0});
    entry.points = map.value("points", size_t{0});
    list->maps.push_back(entry);
  }
  list->last = ReadId<MapId>(text, "last", false);
}

MapGraph::Origin ReadOrigin(const json& link) {
  const std::string name = link.value("origin", std::string("overlap"));
  return name == "new_map"   ? MapGraph::Origin::kNewMap
         : name == "entered" ? MapGraph::Origin::kEntered
                             : MapGraph::Origin::kOverlap;
}

void ReadMapGraph(const json& text, DescribedGraph* described) {
  MapGraph::State state;
  for (const json& map : text.at("maps")) {
    const MapId id = ReadId<MapId>(map, "map", true);
    state.maps.push_back(id);
    MapLabel& label = described->labels[id];
    label.keyframes = map.value("keyframes", size_t{0});
    label.points = map.value("points", size_t{0});
    label.robot = map.value("robot", RobotId{0});
    label.owner = ReadId<ProcessId>(map, "owner", false);
    label.is_active = map.value("active", map.value("state", std::string()) == "active");
  }
  for (const json& link : text.at("links")) {
    state.links.push_back(
        {ReadId<MapId>(link, "map", true), ReadId<MapId>(link, "other", true), ReadSimilarity(link), ReadOrigin(link)});
  }
  for (const json& activity : text.at("activities")) {
    state.activities.push_back({ReadId<MapId>(activity, "map", true), ReadId<MapId>(activity, "other", true),
                                activity.at("count").get<uint64_t>()});
  }
  if (text.contains("fused")) {
    for (const json& fused : text.at("fused"))
      state.fused.push_back(
          {ReadId<MapId>(fused, "map", true), ReadId<MapId>(fused, "other", true), ReadSimilarity(fused)});
  }
  described->graph = MapGraph(state);
}

const char* Name(MapGraph::Origin origin) {
  switch (origin) {
    case MapGraph::Origin::kNewMap:
      return "from the new map's beginning";
    case MapGraph::Origin::kOverlap:
      return "from an overlap";
    case MapGraph::Origin::kEntered:
      return "from the tracker";
  }
  return "";
}

/// A similarity in words: enough to judge it by.
std::string Describe(const Sim3d& similarity) {
  const double angle_deg = Eigen::AngleAxisd(similarity.rotation).angle() * 180 / M_PI;
  return fmt::format("scale {:.3f}, turned by {:.1f} deg, moved by {:.3g}", similarity.scale, angle_deg,
                     similarity.translation.norm());
}

}  // namespace

std::vector<MapId> MapList::Ids() const {
  std::vector<MapId> ids;
  for (const Entry& entry : maps) ids.push_back(entry.map);
  return ids;
}

const MapList::Entry* MapList::Find(MapId map) const {
  for (const Entry& entry : maps) {
    if (entry.map == map) return &entry;
  }
  return nullptr;
}

Result<MapList> ParseMapList(const std::string& json) {
  return Parse<MapList>(json, "list of maps", ReadMapList);
}

std::string FormatMapList(const MapList& list) {
  if (list.maps.empty()) return "no map\n";
  TextColumns table({"map", "robot", "keyframes", "points", "revision", "epoch", "state"});
  for (const MapList::Entry& entry : list.maps) {
    const std::string state = entry.epoch == 0     ? "waits for a mapper"
                              : !entry.is_active   ? "dormant"
                              : !entry.owner_alive ? "active, its mapper is gone"
                                                   : "active, owner " + ToString(entry.owner);
    table.Add({ToString(entry.map) + (entry.map == list.last ? " *" : ""), std::to_string(entry.robot),
               std::to_string(entry.keyframes), std::to_string(entry.points), std::to_string(entry.revision),
               std::to_string(entry.epoch), state});
  }
  return table.Format() + (list.last.IsValid() ? "* changed last\n" : "");
}

Result<DescribedGraph> ParseMapGraph(const std::string& json) {
  return Parse<DescribedGraph>(json, "map graph", ReadMapGraph);
}

std::string FormatMapGraph(const DescribedGraph& described) {
  const MapGraph::State state = described.graph.state();
  if (state.maps.empty()) return "no map\n";
  std::string text = fmt::format("{} map{}\n", state.maps.size(), state.maps.size() == 1 ? "" : "s");
  for (const MapId map : state.maps) {
    const auto found = described.labels.find(map);
    const MapLabel label = found == described.labels.end() ? MapLabel() : found->second;
    text += fmt::format("  {}: {} keyframes, {} points, robot {}, {}\n", ToString(map), label.keyframes, label.points,
                        label.robot, label.is_active ? "active" : "dormant");
  }
  std::set<std::pair<MapId, MapId>> linked;
  for (const MapGraph::Link& link : state.links) {
    linked.emplace(link.map, link.other);
    text +=
        fmt::format("{} - {}: activity {}; linked {}: {}\n", ToString(link.map), ToString(link.other),
                    described.graph.ActivityOf(link.map, link.other), Name(link.origin), Describe(link.map_from_other));
  }
  for (const MapGraph::Activity& activity : state.activities) {
    if (linked.count({activity.map, activity.other}) == 0 && linked.count({activity.other, activity.map}) == 0)
      text += fmt::format("{} - {}: activity {}; not linked\n", ToString(activity.map), ToString(activity.other),
                          activity.count);
  }
  for (const MapGraph::Fused& fused : state.fused)
    text += fmt::format("{} went into {}\n", ToString(fused.other), ToString(fused.map));
  return text;
}

}  // namespace portolan
