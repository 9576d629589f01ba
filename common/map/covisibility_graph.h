#pragma once

#include <cstdint>
#include <unordered_map>
#include <utility>
#include <vector>

#include "base/ids.h"

namespace portolan {

/// Which keyframes see common points, and how many (paper Sec. 4: the pose graph's weights). Flat: a keyframe has a
/// hundred neighbours and more, of which a table of tables takes 40 bytes each, these lists 16. Not thread-safe.
class CovisibilityGraph {
 public:
  /// (keyframe, number of common points), by keyframe.
  using Neighbours = std::vector<std::pair<KeyFrameId, int>>;

  /// Those of many points at once, far faster than pair by pair. The graph must be empty.
  /// @param keyframes ascending. @param seen_by of each point the places in `keyframes` of those that see it, each
  /// once.
  void Fill(const std::vector<KeyFrameId>& keyframes, const std::vector<std::vector<uint32_t>>& seen_by);
  /// One more point that both see.
  void Add(KeyFrameId a, KeyFrameId b);
  /// One point less; they must have one.
  void Remove(KeyFrameId a, KeyFrameId b);
  /// Forgets a keyframe, which must have no neighbours any more.
  void Forget(KeyFrameId id);
  /// Whether no two keyframes see a common point.
  bool IsEmpty() const;

  /// Number of points that both see; 0 if unknown.
  int Common(KeyFrameId a, KeyFrameId b) const;
  /// Those with a common point; empty if unknown.
  const Neighbours& Of(KeyFrameId id) const;

 private:
  std::unordered_map<KeyFrameId, Neighbours> neighbours_;
};

}  // namespace portolan
