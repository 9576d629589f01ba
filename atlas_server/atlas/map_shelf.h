#pragma once

#include <functional>
#include <list>
#include <map>
#include <memory>
#include <set>
#include <unordered_map>
#include <utility>
#include <vector>

#include "atlas/overlap_detector.h"
#include "map/map_file.h"
#include "map/protocol.h"
#include "map/replica_set.h"
#include "vocabulary/keyframe_index.h"

namespace portolan {

struct ShelfOptions {
  double memory_mb = 100;  ///< for descriptors, orientations and direct indices of keyframes, 1e6 bytes
  size_t newest = 60;      ///< keyframes that keep theirs while there is but one map: nothing is looked up in it
  /// Keyframes whose descriptors are read from the store in one event: more than a lookup needs.
  size_t loads_an_event = 32;
};

/// All maps as replicas, with the words of their keyframes, and of their descriptors what is used: the newest
/// keyframes' and those looked at last. What is stored and not used goes, and comes back from the store on demand.
/// Pure: no DDS, no threads; one thread uses it.
///
///   MapShelf shelf(options, vocabulary, load);
///   shelf.AddKeyFrame(map, data);  shelf.replicas().AddChunk(chunk);  shelf.ApplyPending();
///   shelf.OnStored(keyframe);                          // from now on its descriptors may go
///   shelf.BeginEvent();
///   detector.Detect(..., shelf.Others(...), shelf.Ensurer(), ...);
///   shelf.Trim();
class MapShelf {
 public:
  /// Reads the data of a keyframe that OnStored() named.
  using Load = std::function<Result<KeyFrameData>(KeyFrameId)>;

  /// @param vocabulary may be null: then no keyframe has words (tests of ownership alone).
  MapShelf(const ShelfOptions& options, std::shared_ptr<const Vocabulary> vocabulary, Load load);

  /// No effect if the keyframe is known.
  void AddKeyFrame(MapId map, KeyFrameData data);
  /// A whole map, whose state waits for ApplyPending(). @param is_stored whether descriptors may go. @param
  /// note_keyframe is called once a keyframe and more, as many take seconds; may be null.
  void TakeIn(StoredMap map, bool is_stored, const std::function<void()>& note_keyframe);
  ReplicaSet& replicas() { return replicas_; }
  const ReplicaSet& replicas() const { return replicas_; }
  const std::map<MapId, MapReplica>& maps() const { return replicas_.replicas(); }
  /// See ReplicaSet; the words of new keyframes are indexed.
  std::vector<MapDelta> ApplyPending();

  /// Null if the map is unknown or has nothing yet.
  const Map* FindMap(MapId map) const;
  /// The words of a keyframe of any map; null if unknown.
  std::shared_ptr<const BowVector> FindWords(KeyFrameId keyframe) const;
  /// Maps that have keyframes, in the order given; unknown ones are passed over.
  std::vector<OtherMap> Others(const std::vector<MapId>& order) const;

  /// The data of a keyframe with direct index, and its words unless `bow` is null. Thread-safe.
  std::shared_ptr<const KeyFrameData> Complete(KeyFrameData data, BowVector* bow) const;

  /// Its descriptors may go from now on.
  void OnStored(KeyFrameId keyframe) { stored_.insert(keyframe); }
  /// Allows for loads_an_event keyframes to be read again.
  void BeginEvent() { loads_left_ = options_.loads_an_event; }
  /// Sees to it that keyframes of a map have their descriptors; false: too many are to be read in this event, go on in
  /// the next. Those that can't be read are left without.
  bool EnsureAppearance(const Map& map, const std::vector<KeyFrameId>& keyframes);
  OverlapDetector::EnsureAppearance Ensurer() {
    return
        [this](const Map& map, const std::vector<KeyFrameId>& keyframes) { return EnsureAppearance(map, keyframes); };
  }
  /// Drops what is beyond the budget, least used first.
  void Trim();

  /// (map, other) where map was seen to have taken keyframes of other, since the last call.
  std::set<std::pair<MapId, MapId>> TakeTakenIn() { return std::exchange(taken_in_, {}); }

  /// The map is no more.
  void Remove(MapId map);
  /// The map went into another, which may not have its keyframes yet.
  void Remove(MapId map, MapId into);

  double appearance_mb() const { return 1e-6 * static_cast<double>(appearance_bytes_); }
  size_t num_appearances() const { return appearances_.size(); }
  size_t indexed_keyframes() const { return words_.total_size(); }
  uint64_t loads() const { return loads_; }
  uint64_t load_failures() const { return load_failures_; }

 private:
  struct Appearance {
    MapId map;
    KeyFrameId keyframe;
    size_t bytes = 0;
  };
  using Appearances = std::list<Appearance>;

  bool HasKeyFrame(MapId map, KeyFrameId keyframe) const;
  /// What Complete() made of a keyframe that is new to the map.
  void Put(MapId map, const std::shared_ptr<const KeyFrameData>& complete, BowVector bow);
  void NoteAppearance(MapId map, const KeyFrameData& data);
  void Touch(KeyFrameId keyframe);
  void ForgetAppearance(KeyFrameId keyframe);
  void Index(const MapDelta& delta);
  void ForgetUnusedWords();
  bool IsOverBudget() const;
  size_t NumMapsWithKeyFrames() const;

  ShelfOptions options_;
  std::shared_ptr<const Vocabulary> vocabulary_;
  Load load_;
  ReplicaSet replicas_;
  KeyFrameIndex words_;  // of the keyframes in each map, a part for each
  std::unordered_map<KeyFrameId, std::shared_ptr<const BowVector>> bags_;  // of all keyframes, in a map or not yet
  Appearances appearances_;                                                // in memory, last used last
  std::unordered_map<KeyFrameId, Appearances::iterator> appearance_of_;
  std::set<KeyFrameId> stored_;
  std::set<std::pair<MapId, MapId>> taken_in_;
  size_t appearance_bytes_ = 0;
  size_t loads_left_ = 0;
  uint64_t loads_ = 0, load_failures_ = 0;
};

}  // namespace portolan
