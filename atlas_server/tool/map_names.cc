#include "tool/map_names.h"

#include <charconv>
#include <functional>

namespace portolan {
namespace {

/// A number that is the whole text.
std::optional<uint64_t> ParseNumber(const std::string& text, int base, uint64_t most) {
  uint64_t value = 0;
  const char* end = text.data() + text.size();
  const auto [parsed, error] = std::from_chars(text.data(), end, value, base);
  if (text.empty() || error != std::errc() || parsed != end || value > most) return std::nullopt;
  return value;
}

bool StartsWith(const std::string& text, const std::string& start) {
  return text.compare(0, start.size(), start) == 0;
}

bool EndsWith(const std::string& text, const std::string& end) {
  return text.size() >= end.size() && text.compare(text.size() - end.size(), end.size(), end) == 0;
}

std::string Join(const std::vector<MapId>& maps) {
  std::string names;
  for (const MapId map : maps) names += (names.empty() ? "" : ", ") + ToString(map);
  return names;
}

std::vector<MapId> Select(const std::vector<MapId>& maps, const std::function<bool(const std::string&)>& fits) {
  std::vector<MapId> selected;
  for (const MapId map : maps) {
    if (fits(ToString(map))) selected.push_back(map);
  }
  return selected;
}

}  // namespace

std::optional<uint64_t> ParseId(const std::string& text) {
  if (text == "none") return 0;
  const size_t first = text.find('.'), second = text.find('.', first + 1);
  if (first == std::string::npos || second == std::string::npos) return std::nullopt;
  const auto robot = ParseNumber(text.substr(0, first), 10, 65535);
  const auto session = ParseNumber(text.substr(first + 1, second - first - 1), 16, 0xffffff);
  const auto sequence = ParseNumber(text.substr(second + 1), 10, 0xffffff);
  if (!robot || !session || !sequence) return std::nullopt;
  return Id<void>(static_cast<RobotId>(*robot), static_cast<uint32_t>(*session), static_cast<uint32_t>(*sequence))
      .value;
}

Result<MapId> ChooseMap(const std::string& name, const std::vector<MapId>& maps, MapId last) {
  if (maps.empty()) return Error{"the atlas has no map"};
  if (name == "last") {
    if (!last.IsValid()) return Error{"no map has changed since the atlas_server started: name one of " + Join(maps)};
    return last;
  }
  if (name.empty()) return Error{"a map's name is empty"};
  const std::function<bool(const std::string&)> rules[] = {
      [&](const std::string& map) { return map == name; },
      [&](const std::string& map) { return EndsWith(map, "." + name); },
      [&](const std::string& map) { return StartsWith(map, name) || EndsWith(map, name); }};
  for (const auto& rule : rules) {
    const std::vector<MapId> fitting = Select(maps, rule);
    if (fitting.size() == 1) return fitting[0];
    if (!fitting.empty()) return Error{"'" + name + "' may be any of " + Join(fitting)};
  }
  return Error{"no map is called '" + name + "': there are " + Join(maps)};
}

}  // namespace portolan
