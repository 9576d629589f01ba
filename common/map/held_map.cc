#include "map/held_map.h"

#include <cinttypes>
#include <cstdio>

#include "base/hash.h"

namespace portolan {

HeldMap MeasureMap(const Map& map) {
  return {map.id(), map.epoch(), map.revision(), map.keyframes().size(), map.points().size(), HashMap(map)};
}

bool HasSameContent(const HeldMap& a, const HeldMap& b) {
  return a.map == b.map && a.keyframes == b.keyframes && a.points == b.points && a.hash == b.hash;
}

std::string ToText(const HeldMap& held) {
  return "epoch " + std::to_string(held.epoch) + " revision " + std::to_string(held.revision) + " keyframes " +
         std::to_string(held.keyframes) + " points " + std::to_string(held.points) + " hash " + FormatHash(held.hash);
}

Result<HeldMap> ParseHeldMap(MapId map, const std::string& text) {
  uint64_t epoch = 0, revision = 0, keyframes = 0, points = 0, hash = 0;
  int end = 0;
  const int read =
      std::sscanf(text.c_str(),
                  "epoch %" SCNu64 " revision %" SCNu64 " keyframes %" SCNu64 " points %" SCNu64 " hash %" SCNx64 "%n",
                  &epoch, &revision, &keyframes, &points, &hash, &end);
  if (read != 5 || static_cast<size_t>(end) != text.size())
    return Error{"map " + ToString(map) + ": '" + text +
                 "' does not tell what is held: expected epoch, revision, keyframes, points, hash"};
  return HeldMap{map, epoch, revision, keyframes, points, hash};
}

}  // namespace portolan
