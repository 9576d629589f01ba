#pragma once

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

  /// One more point that both see.
  void Add(KeyFrameId a, KeyFrameId b);
  /// One point less; they must have one.
  void Remove(KeyFrameId a, KeyFrameId b);
  /// Forgets a keyframe, which must have no neighbours any more.
  void Forget(KeyFrameId id);

  /// Number of points that both see; 0 if unknown.
  int Common(KeyFrameId a, KeyFrameId b) const;
  /// Those with a common point; empty if unknown.
  const Neighbours& Of(KeyFrameId id) const;

 private:
  std::unordered_map<KeyFrameId, Neighbours> neighbours_;
};

}  // namespace portolan
