#include "tool/swap_report.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>
#include <stdexcept>

#include "base/hash.h"
#include "tool/map_names.h"

namespace portolan {
namespace {

using nlohmann::json;

template <class IdType>
IdType ReadId(const json& entry, const char* key) {
  const std::string text = entry.at(key).get<std::string>();
  const auto id = ParseIdAs<IdType>(text);
  if (!id) throw std::invalid_argument(fmt::format("'{}' of \"{}\" is no id", text, key));
  return *id;
}

HeldMap ReadHeld(MapId map, const json& entry) {
  return {map,
          entry.at("epoch").get<Epoch>(),
          entry.at("revision").get<Revision>(),
          entry.at("keyframes").get<size_t>(),
          entry.at("points").get<size_t>(),
          std::stoull(entry.at("hash").get<std::string>(), nullptr, 16)};
}

/// The owner of a map changes with a mapper, its content does not: revision and epoch may rise, and the content stays.
bool IsOfOneState(const SwapReport& report, const SwapReport::Entry& entry) {
  return report.role == "backend_mapper" ||
         (entry.before.epoch == entry.after.epoch && entry.before.revision == entry.after.revision);
}

std::string Describe(const HeldMap& held) {
  return fmt::format("{} keyframes, {} points, hash {} at revision {} in epoch {}", held.keyframes, held.points,
                     FormatHash(held.hash), held.revision, held.epoch);
}

}  // namespace

std::string SwapReport::Problem() const {
  for (const Entry& entry : maps) {
    if (IsOfOneState(*this, entry) && !HasSameContent(entry.before, entry.after)) {
      return fmt::format("map {} is not the same after the swap: {} before, {} after", ToString(entry.before.map),
                         Describe(entry.before), Describe(entry.after));
    }
  }
  return "";
}

Result<SwapReport> ParseSwapReport(const std::string& text) {
  SwapReport report;
  try {
    const json answer = json::parse(text);
    report.role = answer.at("role").get<std::string>();
    report.robot = answer.at("robot").get<RobotId>();
    report.from = ReadId<ProcessId>(answer, "from");
    report.to = ReadId<ProcessId>(answer, "to");
    report.seconds = answer.at("seconds").get<double>();
    for (const json& entry : answer.at("maps")) {
      const MapId map = ReadId<MapId>(entry, "map");
      report.maps.push_back({ReadHeld(map, entry.at("before")), ReadHeld(map, entry.at("after"))});
    }
  } catch (const std::exception& error) {
    return Error{fmt::format("the atlas_server's answer to the swap can't be read: {}", error.what())};
  }
  return report;
}

std::string FormatSwapReport(const SwapReport& report) {
  std::string text = fmt::format("ok: {} of robot {}: {} has left its place to {}, in {:.2f} s\n", report.role,
                                 report.robot, ToString(report.from), ToString(report.to), report.seconds);
  for (const SwapReport::Entry& entry : report.maps) {
    const char* verdict = HasSameContent(entry.before, entry.after) ? "the same"
                          : IsOfOneState(report, entry)             ? "NOT THE SAME"
                                                                    : "gone on since";
    text += fmt::format("map {}: {}\n  before: {}\n  after:  {}\n", ToString(entry.before.map), verdict,
                        Describe(entry.before), Describe(entry.after));
  }
  return text;
}

}  // namespace portolan
