#pragma once

#include <cstdint>
#include <memory>
#include <unordered_map>
#include <vector>

#include "base/ids.h"
#include "vocabulary/bow_vector.h"

namespace portolan {

/// How much a stored keyframe shares with a query.
struct SharedWords {
  KeyFrameId keyframe;
  int words = 0;     ///< number of words in common
  double score = 0;  ///< similarity of the bags, as BowScore
};

/// Inverted index: word -> keyframes that saw it (paper Sec. 2), with the bags for scoring. Not thread-safe.
class KeyFrameIndex {
 public:
  /// Adding an id again replaces its bag. The bag is shared, not copied: it is part of the keyframe's data (WordsOf).
  void Add(KeyFrameId keyframe, std::shared_ptr<const BowVector> bow);
  /// No effect for an unknown id.
  void Remove(KeyFrameId keyframe);
  /// Keyframes that share at least one word with the query, scored, sorted by words (most first), then by id.
  std::vector<SharedWords> Query(const BowVector& bow) const;
  /// The bag of a keyframe, null if unknown.
  const BowVector* Find(KeyFrameId keyframe) const;
  size_t size() const { return slot_of_.size(); }

 private:
  /// Place of a keyframe in slots_: half the bytes of its id, and each keyframe is listed under a thousand words and
  /// more.
  using SlotNumber = uint32_t;
  struct Slot {
    KeyFrameId keyframe;  // none: free
    std::shared_ptr<const BowVector> bow;
  };
  SlotNumber TakeSlot();

  std::vector<Slot> slots_;
  std::vector<SlotNumber> free_;
  std::unordered_map<KeyFrameId, SlotNumber> slot_of_;
  /// With the weight, so that a query scores all keyframes in one pass over its words.
  struct Entry {
    SlotNumber slot;
    float weight;
  };
  std::unordered_map<uint32_t, std::vector<Entry>> inverted_;
};

}  // namespace portolan
