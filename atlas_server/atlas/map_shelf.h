#pragma once

#include <functional>
#include <list>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <unordered_map>
#include <utility>
#include <vector>

#include "atlas/overlap_detector.h"
#include "map/held_map.h"
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
  double maps_mb = 400;  ///< for maps that may be paged, without descriptors and words, 1e6 bytes
  /// Keyframes of paged maps read for a lookup, on average: at about a millisecond each, so that lookups over more maps
  /// than have room do not fall behind.
  size_t paged_a_lookup = 25;
};

/// What a map takes in memory, about, without its keyframes' descriptors and words.
size_t GeometryBytes(const Map& map);

/// All maps as replicas, with the words of their keyframes, and of their descriptors what is used: the newest
/// keyframes' and those looked at last. What is stored and not used goes, and comes back from the store on demand: the
/// descriptors of single keyframes, and maps as a whole. Of a map that is paged the words stay, which keyframes are
/// covisible, and its figures: it is looked up in and told of like the others, and read when more of it is needed.
/// Pure: no DDS, no threads; one thread uses it.
///
///   MapShelf shelf(options, vocabulary, load, load_state);
///   shelf.AddKeyFrame(map, data);  shelf.AddChunk(chunk);  shelf.ApplyPending();
///   shelf.OnStored(keyframe);                          // from now on its descriptors may go
///   shelf.BeginLookUp();
///   detector.Detect(..., shelf.Others(...), shelf.Ensurer(), ...);
///   shelf.Trim(may_be_paged);
class MapShelf {
 public:
  /// Reads the data of a keyframe that OnStored() named, or of one of a paged map.
  using Load = std::function<Result<KeyFrameData>(KeyFrameId)>;
  /// Reads the state of a paged map.
  using LoadState = std::function<Result<MapDelta>(MapId)>;
  /// Whether all of a map is stored, nothing new is expected of it, and nobody holds on to it.
  using MayBePaged = std::function<bool(const Map&)>;

  /// @param vocabulary may be null: then no keyframe has words (tests of ownership alone).
  MapShelf(const ShelfOptions& options, std::shared_ptr<const Vocabulary> vocabulary, Load load,
           LoadState load_state = nullptr);

  // What comes of a paged map, unless it is known, brings it back; one that can't be read begins anew with the next
  // state that comes.
  /// No effect if the keyframe is known.
  void AddKeyFrame(MapId map, KeyFrameData data);
  void AddChunk(MapDeltaChunk chunk);
  /// See ReplicaSet.
  void Announce(MapId map, Epoch epoch, Revision revision);
  /// A whole map, whose state waits for ApplyPending(). @param is_stored whether descriptors may go. @param
  /// note_keyframe is called once a keyframe and more, as many take seconds; may be null.
  void TakeIn(StoredMap map, bool is_stored, const std::function<void()>& note_keyframe);
  ReplicaSet& replicas() { return replicas_; }
  const ReplicaSet& replicas() const { return replicas_; }
  /// Those in memory.
  const std::map<MapId, MapReplica>& maps() const { return replicas_.replicas(); }
  /// See ReplicaSet; the words of new keyframes are indexed.
  std::vector<MapDelta> ApplyPending();

  /// Null if the map is unknown, has nothing yet, or is not in memory.
  const Map* FindMap(MapId map) const;
  /// The same, but that a paged map is read, which takes a while; null also if it can't be. What was returned before
  /// stays valid until Trim().
  const Map* BringIn(MapId map);

  /// What is told of a map, in memory or not.
  struct Figures {
    Epoch epoch = 0;
    Revision revision = 0;  ///< 0: it has nothing yet
    size_t keyframes = 0, points = 0;
    bool is_paged = false;
  };
  std::optional<Figures> FiguresOf(MapId map) const;
  /// The same with the hash of its content; none if it has nothing yet.
  std::optional<HeldMap> Measure(MapId map) const;
  /// Of all maps that have something, in memory or not; sorted.
  std::vector<MapId> Ids() const;
  size_t num_maps() const { return maps().size() + paged_.size(); }
  /// Whether nothing of the map is known.
  bool IsEmpty(MapId map) const { return paged_.count(map) == 0 && replicas_.IsEmpty(map); }

  /// The words of a keyframe of any map; null if unknown.
  std::shared_ptr<const BowVector> FindWords(KeyFrameId keyframe) const;
  /// Maps that have keyframes, in the order given; unknown ones and those that can't be read are passed over. Of paged
  /// ones one is opened in an event.
  std::vector<OtherMap> Others(const std::vector<MapId>& order);

  /// The data of a keyframe with direct index, and its words unless `bow` is null. Thread-safe.
  std::shared_ptr<const KeyFrameData> Complete(KeyFrameData data, BowVector* bow) const;

  /// Its descriptors may go from now on.
  void OnStored(KeyFrameId keyframe) { stored_.insert(keyframe); }
  /// Allows for loads_an_event keyframes, and one paged map, to be read again.
  void BeginEvent();
  /// The same for one of many lookups, but for maps: those that come next read none until paged_a_lookup is kept.
  void BeginLookUp();
  /// Whether more was asked for in this event than could be read.
  bool came_short() const { return came_short_; }
  /// Sees to it that keyframes of a map have their descriptors; false: too many are to be read in this event, go on in
  /// the next. Those that can't be read are left without.
  bool EnsureAppearance(const Map& map, const std::vector<KeyFrameId>& keyframes);
  OverlapDetector::EnsureAppearance Ensurer() {
    return
        [this](const Map& map, const std::vector<KeyFrameId>& keyframes) { return EnsureAppearance(map, keyframes); };
  }
  /// Drops what is beyond the budgets, least used first; the map that was read last stays. @param may_be_paged
  /// null: no map may.
  void Trim(const MayBePaged& may_be_paged = nullptr);

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
  size_t num_paged() const { return paged_.size(); }
  uint64_t map_loads() const { return map_loads_; }
  uint64_t map_load_failures() const { return map_load_failures_; }

 private:
  struct Appearance {
    MapId map;
    KeyFrameId keyframe;
    size_t bytes = 0;
  };
  using Appearances = std::list<Appearance>;
  /// What stays of a map that is not in memory.
  struct Paged {
    HeldMap held;
    std::unordered_map<KeyFrameId, std::vector<KeyFrameId>> neighbours;  // of each of its keyframes
    bool is_damaged = false;
  };

  bool HasKeyFrame(MapId map, KeyFrameId keyframe) const;
  std::vector<MapId> MapsWith(KeyFrameId keyframe) const;
  std::optional<std::vector<KeyFrameId>> Neighbours(MapId map, KeyFrameId keyframe, size_t most) const;
  bool ExpectState(MapId map, Epoch epoch, Revision revision);
  const Map* Open(MapId map);
  Result<MapReplica> ReadReplica(const HeldMap& held);
  void Page(MapId map);
  void PageMaps(const MayBePaged& may_be_paged);
  void ForgetPaged(MapId map);
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
  LoadState load_state_;
  ReplicaSet replicas_;
  std::map<MapId, Paged> paged_;    // none of them in replicas_
  std::map<MapId, uint64_t> used_;  // number of the last use
  uint64_t uses_ = 0;
  MapId last_read_;
  KeyFrameIndex words_;  // of the keyframes in each map, a part for each
  std::unordered_map<KeyFrameId, std::shared_ptr<const BowVector>> bags_;  // of all keyframes, in a map or not yet
  Appearances appearances_;                                                // in memory, last used last
  std::unordered_map<KeyFrameId, Appearances::iterator> appearance_of_;
  std::set<KeyFrameId> stored_;
  std::set<std::pair<MapId, MapId>> taken_in_;
  size_t appearance_bytes_ = 0;
  size_t loads_left_ = 0, map_loads_left_ = 0;
  size_t ahead_ = 0;  // keyframes of paged maps that were read for lookups to come
  bool came_short_ = false;
  uint64_t loads_ = 0, load_failures_ = 0, map_loads_ = 0, map_load_failures_ = 0;
};

}  // namespace portolan
