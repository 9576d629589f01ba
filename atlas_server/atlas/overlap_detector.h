#pragma once

#include <deque>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <unordered_set>
#include <vector>

#include "base/result.h"
#include "base/statistics.h"
#include "map/map.h"
#include "place_recognition/candidates.h"
#include "place_recognition/place_agreement.h"
#include "place_recognition/sim3_verification.h"
#include "vocabulary/keyframe_index.h"

namespace portolan {

struct OverlapOptions {
  OverlapOptions() {
    candidates.most = 3;
    candidates.most_scored = 20;
  }
  /// Of each map, by words: as loops are looked for, but that only the keyframes with the most shared words are scored.
  CandidateOptions candidates;
  Sim3VerificationOptions verification;
  PlaceAgreementOptions agreement;  ///< of two keyframes that say the same
  /// Keyframes of other maps in which a keyframe's words are looked up. Maps beyond that take turns, from keyframe to
  /// keyframe.
  size_t max_looked_up = 5000;
  int max_verified = 3;  ///< candidates of a keyframe that are verified, over all maps
  /// Keyframes before, among whose candidates a candidate's group must be: lookalikes come singly.
  int consistent_rounds = 3;
  int max_keyframes_apart = 10;  ///< of the two keyframes that agree

  /// Ranges of each field; the message names the field, its value and what was expected.
  Status Check() const;
};

/// A map in which a place is looked for: by what is known of its keyframes at all times, and then in the map itself,
/// which may have to be read first.
struct OtherMap {
  MapId id;
  /// Of its keyframes, as its part; one index for all maps that are looked in at a time.
  const KeyFrameIndex* words = nullptr;
  NeighboursOf neighbours;
  std::function<const Map*()> open;  ///< null: not yet, or it can't be read

  /// Of a map in memory, which must outlive this.
  static OtherMap Of(const Map& map, const KeyFrameIndex* words) {
    return {map.id(), words, NeighboursIn(map), [&map] { return &map; }};
  }
  size_t num_keyframes() const { return words->size(id); }
};

/// What a keyframe shares with those of each map, in their order: its words are looked up once for all of them.
std::vector<std::vector<SharedWords>> QueryMaps(const BowVector& bow, const std::vector<const OtherMap*>& maps);

/// A candidate that was looked at and not taken, and why.
struct OverlapRefusal {
  MapId map, other;
  KeyFrameId current, candidate;
  std::string reason;
};

/// A keyframe that sees a place of another map.
struct DetectedOverlap {
  MapId map, other;
  KeyFrameId current, matched;  ///< of map, of other
  VerifiedPlace place;          ///< query: current; candidate: matched
  Sim3d other_from_map;
};

/// What came of one keyframe.
struct OverlapDetection {
  size_t maps = 0, keyframes = 0;  ///< looked up in
  int candidates = 0;              ///< by words
  int consistent = 0;              ///< of them, with those of the keyframes before
  int verified = 0;                ///< of them, looked at by geometry
  std::vector<OverlapRefusal> refusals;
  std::optional<DetectedOverlap> confirmed;  ///< by geometry; an overlap only once another keyframe says the same
  std::optional<DetectedOverlap> overlap;
};

/// Finds the places of other maps that a map's new keyframes see (paper Sec. 6, step 1). Pure and deterministic; one
/// thread uses it.
///
///   OverlapDetector detector(options);
///   OverlapDetection detection = detector.Detect(map, keyframe, bow, others, ensure, &times);  // each new keyframe,
///   in order if (detection.overlap) ... detector.Forget(map); // after a fusion
///
/// Time for a keyframe is bounded however many maps there are: its words are looked up in max_looked_up keyframes, of
/// which at most candidates.most_scored a map are scored, and at most max_verified candidates are verified: the best of
/// the map with the most mutual activity, then those that share most with the keyframe, and of the other maps one in
/// turn.
class OverlapDetector {
 public:
  /// Sees to it that the verification can read descriptors and direct index of these keyframes of a map (in memory, or
  /// from the store). False: not yet; the candidate is looked at with a later keyframe.
  using EnsureAppearance = std::function<bool(const Map& map, const std::vector<KeyFrameId>& keyframes)>;

  explicit OverlapDetector(const OverlapOptions& options) : options_(options) {}

  /// @param current in `map`, with its landmarks. @param bow its words. @param others most mutual activity first; `map`
  /// not among them.
  /// @param ensure may be null: everything is there. @param times "lookup_words", "lookup_verify" and the steps of
  /// VerifyPlace, ms.
  OverlapDetection Detect(const Map& map, KeyFrameId current, const BowVector& bow, const std::vector<OtherMap>& others,
                          const EnsureAppearance& ensure, StageTimes* times);

  /// Forgets what was found of a map, from it and in it.
  void Forget(MapId map);

 private:
  struct Found {
    const OtherMap* other = nullptr;
    Candidate candidate;
    bool refused_before = false;  // verified with the last keyframe, and refused
  };
  struct Confirmation {
    int round = 0;
    DetectedOverlap overlap;
  };
  /// Of one map's keyframes.
  struct Memory {
    int round = 0;
    size_t turn = 0;                                    // of the maps that take turns
    std::deque<std::unordered_set<KeyFrameId>> rounds;  // candidates of the keyframes before, with their neighbours
    std::unordered_set<KeyFrameId> refused;             // with the last keyframe, with their neighbours
    std::map<MapId, int> verified;                      // round in which a candidate of the map last was
    std::deque<Confirmation> confirmations;
  };

  std::vector<const OtherMap*> ChooseMaps(const std::vector<OtherMap>& others, Memory* memory) const;
  std::vector<Found> FindConsistent(const BowVector& bow, const std::vector<const OtherMap*>& maps, Memory* memory,
                                    OverlapDetection* detection) const;
  void GiveATurn(const Memory& memory, std::vector<Found>* candidates) const;
  std::vector<KeyFrameId> GroupOf(const OtherMap& map, KeyFrameId keyframe) const;
  bool EnsureBoth(const Map& map, KeyFrameId current, const Map& other, KeyFrameId matched,
                  const EnsureAppearance& ensure) const;
  std::vector<DetectedOverlap> Verify(const Map& map, KeyFrameId current, const std::vector<Found>& candidates,
                                      const EnsureAppearance& ensure, Memory* memory, OverlapDetection* detection,
                                      StageTimes* times) const;
  bool SayTheSame(const Map& map, const DetectedOverlap& a, const DetectedOverlap& b) const;
  void Confirm(const Map& map, const DetectedOverlap& confirmed, Memory* memory, OverlapDetection* detection) const;

  OverlapOptions options_;
  std::map<MapId, Memory> memories_;
};

/// Keyframes whose descriptors VerifyPlace reads, on the query's side and on the candidate's.
std::vector<KeyFrameId> KeyFramesRead(const Map& map, KeyFrameId keyframe, const NeighbourhoodOptions& options,
                                      size_t most);

}  // namespace portolan
