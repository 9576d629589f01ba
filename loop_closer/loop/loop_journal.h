#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <optional>
#include <string>
#include <vector>

#include "base/log.h"
#include "base/statistics.h"
#include "base/time.h"
#include "loop/loop_detector.h"
#include "map_optimization/keyframe_adjustment.h"

namespace portolan {

enum class LoopJobKind { kLoop, kGlobalBundleAdjustment, kForwardBundleAdjustment };
constexpr size_t kNumLoopJobKinds = 3;
/// "loop correction", "global BA", "FBA".
const char* Name(LoopJobKind kind);

/// A loop from its detection to the map that has it.
struct ClosureRecord {
  KeyFrameId current, matched;
  Timestamp stamp, matched_stamp;
  Sim3d corrected_from_map;  ///< around the current keyframe
  int inliers = 0, group_inliers = 0;
  StageTimes times;  ///< of each step, milliseconds; "applied": from detection to the map that has it
  bool is_applied = false;
  std::string problem;  ///< why it is not
};

/// How the jobs of a kind ended.
struct LoopJobCounters {
  uint64_t tried = 0;
  uint64_t fruitless = 0;  ///< no proposal came out: the map would not be better, or is too small
  uint64_t cancelled = 0;
  uint64_t applied = 0, refused = 0;  ///< by the map's owner
  uint64_t unanswered = 0;            ///< by now
  std::optional<LossChange> losses;   ///< of the last that came to comparing them
};

struct LoopCounters {
  uint64_t looked_at = 0, passed_over = 0, candidates = 0, consistent = 0, refused = 0, confirmed = 0, closed = 0,
           failed = 0;
  std::array<uint64_t, kNumRefusalKinds> refusals{};  ///< by kind; of `refused` are those that were verified
  std::array<LoopJobCounters, kNumLoopJobKinds> jobs;

  const LoopJobCounters& of(LoopJobKind kind) const { return jobs[static_cast<size_t>(kind)]; }
  uint64_t refusals_of(RefusalKind kind) const { return refusals[static_cast<size_t>(kind)]; }
  /// Of all kinds.
  uint64_t cancelled() const;
};

/// What loop closing found, refused and did: told in the log, counted, and kept for the report.
class LoopJournal {
 public:
  void NotePassedOver() { ++counters_.passed_over; }
  /// One keyframe that was looked at. Of the refusals that verification made one a second is told at info.
  void NoteDetection(const Map& map, KeyFrameId keyframe, const LoopDetection& detection);

  /// A loop that is to be closed. @param times of its detection. @return its place in closures().
  size_t OpenClosure(const Map& map, const DetectedLoop& loop, const StageTimes& times);
  void AddTimes(size_t closure, const StageTimes& times);
  /// One that was noted as failed, for want of an answer, too.
  void NoteApplied(size_t closure, double since_detection_ms);
  void NoteFailed(size_t closure, const std::string& problem);

  void NoteTried(LoopJobKind kind) { ++Of(kind).tried; }
  void NoteLosses(LoopJobKind kind, const LossChange& losses) { Of(kind).losses = losses; }
  void NoteCancelled(LoopJobKind kind, MapId map);
  void NoteFruitless(LoopJobKind kind, MapId map, const std::string& reason);
  void NoteProposed(LoopJobKind kind, MapId map);
  void NoteUnanswered(LoopJobKind kind, const std::string& reason);
  /// @param refusal empty: applied. @param is_late NoteUnanswered was called for it.
  void NoteAnswered(LoopJobKind kind, MapId map, const std::string& refusal, bool is_late);

  const LoopCounters& counters() const { return counters_; }
  const std::vector<ClosureRecord>& closures() const { return closures_; }
  /// Of candidates that were verified, the last ones.
  const std::deque<LoopRefusal>& refusals() const { return refusals_; }

 private:
  LoopJobCounters& Of(LoopJobKind kind) { return counters_.jobs[static_cast<size_t>(kind)]; }
  void NoteRefusal(const Map& map, const LoopRefusal& refusal);

  LoopCounters counters_;
  std::vector<ClosureRecord> closures_;
  std::deque<LoopRefusal> refusals_;
  LogThrottle refusal_log_;
};

}  // namespace portolan
