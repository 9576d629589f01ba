// The map graph as JSON and for Graphviz.

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "atlas/map_graph.h"

namespace portolan {
namespace {

const char* Name(MapGraph::Origin origin) {
  switch (origin) {
    case MapGraph::Origin::kNewMap:
      return "new_map";
    case MapGraph::Origin::kOverlap:
      return "overlap";
    case MapGraph::Origin::kEntered:
      return "entered";
  }
  return "";
}

void AddSimilarity(const Sim3d& s, nlohmann::json* entry) {
  (*entry)["scale"] = s.scale;
  (*entry)["rotation"] = {s.rotation.x(), s.rotation.y(), s.rotation.z(), s.rotation.w()};
  (*entry)["translation"] = {s.translation.x(), s.translation.y(), s.translation.z()};
}

}  // namespace

std::string ToJson(const MapGraph& graph, const std::map<MapId, MapLabel>& labels) {
  const MapGraph::State state = graph.state();
  nlohmann::json json = {{"maps", nlohmann::json::array()},
                         {"links", nlohmann::json::array()},
                         {"activities", nlohmann::json::array()},
                         {"fused", nlohmann::json::array()}};
  for (const MapId map : state.maps) {
    nlohmann::json entry = {{"map", ToString(map)}};
    if (const auto label = labels.find(map); label != labels.end()) {
      entry.update({{"keyframes", label->second.keyframes},
                    {"points", label->second.points},
                    {"robot", label->second.robot},
                    {"owner", ToString(label->second.owner)},
                    {"active", label->second.is_active}});
    }
    json["maps"].push_back(std::move(entry));
  }
  for (const MapGraph::Link& link : state.links) {
    nlohmann::json entry = {
        {"map", ToString(link.map)}, {"other", ToString(link.other)}, {"origin", Name(link.origin)}};
    AddSimilarity(link.map_from_other, &entry);
    json["links"].push_back(std::move(entry));
  }
  for (const MapGraph::Activity& activity : state.activities)
    json["activities"].push_back(
        {{"map", ToString(activity.map)}, {"other", ToString(activity.other)}, {"count", activity.count}});
  for (const MapGraph::Fused& fused : state.fused) {
    nlohmann::json entry = {{"map", ToString(fused.map)}, {"other", ToString(fused.other)}};
    AddSimilarity(fused.map_from_other, &entry);
    json["fused"].push_back(std::move(entry));
  }
  return json.dump();
}

std::string ToDot(const MapGraph& graph, const std::map<MapId, MapLabel>& labels) {
  const MapGraph::State state = graph.state();
  std::string dot = "graph maps {\n  node [shape=box];\n";
  for (const MapId map : state.maps) {
    const auto label = labels.find(map);
    const MapLabel of = label == labels.end() ? MapLabel() : label->second;
    dot += fmt::format("  \"{0}\" [label=\"{0}\\n{1} keyframes, {2} points\"{3}];\n", ToString(map), of.keyframes,
                       of.points, of.is_active ? ", style=bold" : "");
  }
  std::set<std::pair<MapId, MapId>> drawn;
  for (const MapGraph::Link& link : state.links) {
    drawn.emplace(link.map, link.other);
    dot +=
        fmt::format("  \"{}\" -- \"{}\" [label=\"{} ({}, scale {:.3f})\"];\n", ToString(link.map), ToString(link.other),
                    graph.ActivityOf(link.map, link.other), Name(link.origin), link.map_from_other.scale);
  }
  for (const MapGraph::Activity& activity : state.activities) {
    if (drawn.count({activity.map, activity.other}) == 1) continue;
    dot += fmt::format("  \"{}\" -- \"{}\" [label=\"{}\", style=dashed];\n", ToString(activity.map),
                       ToString(activity.other), activity.count);
  }
  return dot + "}\n";
}

}  // namespace portolan
