#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "base/ids.h"
#include "base/result.h"

namespace portolan {

/// The inverse of FormatId: "0.3fa21c.17", or "none" for 0. None if the text is no id.
std::optional<uint64_t> ParseId(const std::string& text);

template <class IdType>
std::optional<IdType> ParseIdAs(const std::string& text) {
  const std::optional<uint64_t> value = ParseId(text);
  return value ? std::optional<IdType>(*value) : std::nullopt;
}

/// The map that an operator means: its whole name, its number ("17") where that is unique, a unique beginning or end of
/// its name, or "last".
/// @param last may be none. Fails, naming the candidates, when none or several fit.
Result<MapId> ChooseMap(const std::string& name, const std::vector<MapId>& maps, MapId last);

}  // namespace portolan
