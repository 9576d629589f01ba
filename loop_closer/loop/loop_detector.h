#pragma once

#include <cstdint>
#include <deque>
#include <optional>
#include <string>
#include <unordered_set>
#include <vector>

#include "base/statistics.h"
#include "base/time.h"
#include "geometry/sim3.h"
#include "map/map.h"
#include "place_recognition/candidates.h"
#include "place_recognition/sim3_verification.h"
#include "vocabulary/keyframe_index.h"

namespace portolan {

struct LoopDetectorOptions {
  CandidateOptions candidates;           ///< by words (paper Sec. 5, first step: 75 %)
  Sim3VerificationOptions verification;  ///< by geometry (second step)
  int min_keyframes = 20;                ///< of a map, to look for loops in it
  int min_keyframes_between = 10;        ///< younger ones show the same place without a loop
  /// Keyframes before, among whose candidates a candidate's group must be: lookalikes come singly.
  int consistent_rounds = 3;
  int max_verified = 3;  ///< candidates of a keyframe that are verified: bounds the time
  // A loop is believed when two keyframes say the same of it.
  int max_keyframes_apart = 10;       ///< of those two
  double max_scale_difference = 0.2;  ///< of the two corrections, relative
  double max_rotation_difference_deg = 8;
  double max_distance_difference = 0.2;  ///< of where they put the camera, in its median depths
  // Drift that is believed, in relation to the way between the two places. A look-alike next door claims as much drift
  // as way; town_lap's scale drifts by 1.27 in a lap. The bounds are chosen wide of that, not measured.
  double max_drift_share = 0.5;  ///< of the way
  double max_scale_change = 3;   ///< either way

  /// Ranges of each field; the message names the field, its value and what was expected.
  Status Check() const;
};

enum class RefusalKind : uint8_t {
  kInconsistent,  ///< no candidate of the keyframes before is near it
  kSurplus,       ///< max_verified better ones were verified
  kNotVerified,   ///< by geometry: VerifyPlace has the reason
  kDrift,         ///< more than is believed
  kAmbiguous,     ///< another candidate was verified too, and lies elsewhere
  kContradicted,  ///< by a keyframe before
};
constexpr size_t kNumRefusalKinds = 6;
/// "inconsistent", "surplus", "not_verified", "drift", "ambiguous", "contradicted".
const char* Name(RefusalKind kind);
/// Whether a candidate was verified before it was refused so.
constexpr bool WasVerified(RefusalKind kind) {
  return kind != RefusalKind::kInconsistent && kind != RefusalKind::kSurplus;
}

/// A candidate that was not taken, and why.
struct LoopRefusal {
  KeyFrameId current, candidate;
  Timestamp stamp, candidate_stamp;
  RefusalKind kind = RefusalKind::kNotVerified;
  std::string reason;
};

/// A keyframe that sees a place of the map again.
struct DetectedLoop {
  KeyFrameId current, matched;
  VerifiedPlace place;       ///< query: current; candidate: matched
  Sim3d corrected_from_map;  ///< what the loop says of the map around the current keyframe: where it should be
};

/// What came of one keyframe.
struct LoopDetection {
  std::vector<Candidate> candidates;  ///< by words, best first
  int consistent = 0;                 ///< of them, with those of the keyframes before
  std::vector<LoopRefusal> refusals;
  /// Verified, and contradicted by none before; a loop only once another keyframe says the same.
  std::optional<DetectedLoop> confirmed;
  std::optional<DetectedLoop> loop;
};

/// Finds loops of one map (paper Sec. 5, first and second step). Pure; one thread uses it.
///
///   LoopDetector detector(options);
///   LoopDetection detection = detector.Detect(map, keyframe, index, &times);   // for each new keyframe, in order
///   if (detection.loop) ...
///   detector.Reset();                 // after a loop was closed, or was not; in another map
///   detector.ForgetConfirmations();   // after another correction
class LoopDetector {
 public:
  explicit LoopDetector(const LoopDetectorOptions& options) : options_(options) {}

  /// @param current in `map`, with its landmarks. @param index holds the map's keyframes, and may hold others.
  /// @param times "words" and the steps of VerifyPlace, milliseconds.
  LoopDetection Detect(const Map& map, KeyFrameId current, const KeyFrameIndex& index, StageTimes* times);

  /// Forgets what keyframes before said.
  void Reset();
  /// Forgets what keyframes before measured: the map has moved since. What their words said of it stays true.
  void ForgetConfirmations() { confirmations_.clear(); }

 private:
  std::vector<Candidate> KeepConsistent(const Map& map, KeyFrameId current, LoopDetection* detection);
  std::vector<DetectedLoop> VerifyAll(const Map& map, KeyFrameId current, const std::vector<Candidate>& candidates,
                                      LoopDetection* detection, StageTimes* times) const;
  std::optional<std::string> FindImplausible(const Map& map, const DetectedLoop& loop) const;
  bool Agree(const Map& map, const DetectedLoop& a, const DetectedLoop& b) const;
  void Confirm(const Map& map, const DetectedLoop& confirmed, LoopDetection* detection);

  LoopDetectorOptions options_;
  std::deque<std::unordered_set<KeyFrameId>> rounds_;  // candidates of the keyframes before, with their neighbours
  struct Confirmation {
    int round = 0;
    DetectedLoop loop;
  };
  std::deque<Confirmation> confirmations_;
  int round_ = 0;
};

}  // namespace portolan
