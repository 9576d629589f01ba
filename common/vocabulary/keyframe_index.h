#pragma once

#include <cstdint>
#include <unordered_map>
#include <vector>

#include "base/ids.h"
#include "vocabulary/bow_vector.h"

namespace portolan {

/// How much a stored keyframe shares with a query.
struct SharedWords {
  KeyFrameId keyframe;
  int words = 0;  ///< number of words in common
};

/// Inverted index: word -> keyframes that saw it (paper Sec. 2), with the bags for scoring. Not thread-safe.
class KeyFrameIndex {
 public:
  /// Adding an id again replaces its bag.
  void Add(KeyFrameId keyframe, const BowVector& bow);
  /// No effect for an unknown id.
  void Remove(KeyFrameId keyframe);
  /// Keyframes that share at least one word with the query, sorted by words (most first), then by id.
  std::vector<SharedWords> Query(const BowVector& bow) const;
  /// The bag of a keyframe, null if unknown.
  const BowVector* Find(KeyFrameId keyframe) const;
  size_t size() const { return bags_.size(); }

 private:
  std::unordered_map<uint32_t, std::vector<KeyFrameId>> inverted_;
  std::unordered_map<KeyFrameId, BowVector> bags_;
};

}  // namespace portolan
