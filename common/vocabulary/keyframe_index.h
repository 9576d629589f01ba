#pragma once

#include <cstdint>
#include <map>
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

/// Inverted index: word -> keyframes that saw it (paper Sec. 2), with the bags for scoring. One for several maps has a
/// part for each: a query looks its words up once, however many parts there are. A keyframe may be in several parts.
/// Not thread-safe.
class KeyFrameIndex {
 public:
  /// Adding an id again replaces its bag. The bag is shared, not copied: it is part of the keyframe's data (WordsOf).
  /// @param part here and below may be left out where there is but one.
  void Add(KeyFrameId keyframe, std::shared_ptr<const BowVector> bow, MapId part = MapId());
  /// No effect for an unknown id.
  void Remove(KeyFrameId keyframe, MapId part = MapId());
  /// All its keyframes.
  void RemovePart(MapId part);
  /// Keyframes that share at least one word with the query, scored, sorted by words (most first), then by id.
  std::vector<SharedWords> Query(const BowVector& bow) const;
  /// The same of each of some parts, which differ. @return in their order; nothing of unknown ones.
  std::vector<std::vector<SharedWords>> Query(const BowVector& bow, const std::vector<MapId>& parts) const;
  /// The bag of a keyframe, null if unknown.
  const BowVector* Find(KeyFrameId keyframe, MapId part = MapId()) const;
  /// Keyframes of a part, and of all.
  size_t size(MapId part = MapId()) const;
  size_t total_size() const { return slots_.size() - free_.size(); }

 private:
  /// Place of a keyframe in slots_: half the bytes of its id, and each keyframe is listed under a thousand words and
  /// more.
  using SlotNumber = uint32_t;
  struct Slot {
    KeyFrameId keyframe;  // none: free
    uint32_t part = 0;    // its number
    std::shared_ptr<const BowVector> bow;
  };
  struct Part {
    uint32_t number = 0;
    std::unordered_map<KeyFrameId, SlotNumber> slot_of;
  };
  SlotNumber TakeSlot();
  void FreeSlot(SlotNumber slot);

  std::vector<Slot> slots_;
  std::vector<SlotNumber> free_;
  std::map<MapId, Part> parts_;
  uint32_t next_part_ = 0;
  /// With the weight, so that a query scores all keyframes in one pass over its words.
  struct Entry {
    SlotNumber slot;
    float weight;
  };
  std::unordered_map<uint32_t, std::vector<Entry>> inverted_;
};

}  // namespace portolan
