#pragma once

#include <string>

#include "base/ids.h"
#include "base/result.h"
#include "map/map.h"

namespace portolan {

/// What a process has of a map, in figures: when the map passes from one process to another, both say it and it is
/// compared.
struct HeldMap {
  MapId map;
  Epoch epoch = 0;
  Revision revision = 0;
  size_t keyframes = 0, points = 0;
  uint64_t hash = 0;  ///< HashMap
};

HeldMap MeasureMap(const Map& map);
/// Whether both have the same state of a map, whoever owns it.
bool HasSameContent(const HeldMap& a, const HeldMap& b);

/// One line, without the map's id: "epoch 2 revision 88 keyframes 34 points 2045 hash 0f3c...".
std::string ToText(const HeldMap& held);
Result<HeldMap> ParseHeldMap(MapId map, const std::string& text);

}  // namespace portolan
