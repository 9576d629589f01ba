#pragma once

#include <atomic>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/result.h"
#include "base/statistics.h"
#include "base/time.h"
#include "loop/loop_detector.h"
#include "loop/loop_options.h"
#include "loop/map_follower.h"
#include "map/protocol.h"

namespace portolan {

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

/// Loop closing (paper Sec. 5) of the map that a robot is in: follows it as a replica, looks for loops at each new
/// keyframe, and proposes corrections to the map's owner; in idle times forward sparse BA. Pure: no DDS, no threads;
/// long work is handed out as jobs.
///
///   LoopCloser closer(options, vocabulary, process);
///   closer.follower().AddKeyFrame(message); ...AddChunk(chunk); closer.OnMapperState(state);   // what comes in
///   closer.Update();                                                                            // after each of them
///   if (closer.ShouldCancel()) the job's stop = true;
///   if (auto job = closer.NextJob()) closer.OnJobDone((*job)(stop));                            // or on another
///   thread while (auto correction = closer.TakeCorrection()) publish it;
class LoopCloser {
 public:
  enum class JobKind { kLoop, kGlobalBundleAdjustment, kForwardBundleAdjustment };
  struct JobResult {
    JobKind kind = JobKind::kLoop;
    MapId map;
    Result<MapCorrection> correction = Error{"not run"};
    StageTimes times;
  };
  using Job = std::function<JobResult(const std::atomic<bool>& stop)>;

  /// @param vocabulary may be null, then no loop is found (tests of the replicas alone). @param process of the
  /// corrections.
  LoopCloser(const LoopOptions& options, std::shared_ptr<const Vocabulary> vocabulary, ProcessId process);

  /// Off: another process has the place. It follows the maps and looks for nothing; a loop that is being closed is
  /// ended, other work given up.
  void SetActive(bool is_active);
  bool is_active() const { return is_active_; }
  /// Whether nothing is under way that another process would have to begin anew.
  bool IsAtRest() const { return !running_ && !proposal_ && !outbox_ && !closing_; }

  MapFollower& follower() { return follower_; }
  const MapFollower& follower() const { return follower_; }
  /// Acknowledges keyframes, which are looked at from then on, and corrections. Only of the maps that the robot's own
  /// mapper owns: another's are its loop_closer's to look at.
  void OnMapperState(const MapperState& state);
  /// kGrantOwnership: what a map's owner may be asked to do. kFuseMaps: goes on with the map that took in the other,
  /// and adjusts all of it. kAdjustMap: global BA of a map of the robot's mapper, when nothing else is under way.
  /// kForgetMap.
  void OnCommand(const Command& command);

  /// Applies what came, and looks at one keyframe that is ready. @return whether more wait.
  bool Update();

  /// Work that is due now, on a snapshot of its own; none while a job is under way or its correction is not answered.
  std::optional<Job> NextJob();
  /// Whether the job under way is not worth ending: its map has another owner or is no more, a loop was found
  /// meanwhile, or the place is to pass on.
  bool ShouldCancel() const;
  /// The job under way came back, or (null) was cancelled.
  void OnJobDone(JobResult result);
  void OnJobCancelled();
  /// What is to be published, once.
  std::optional<MapCorrection> TakeCorrection();

  /// Nobody answered for a correction that was published: the owner is gone.
  void ForgetCorrection(const std::string& reason);
  bool AwaitsAnswer() const { return proposal_.has_value(); }

  /// For lockstep: the last keyframe looked at (or passed over), the map it came in, and whether something of it is
  /// still under way.
  KeyFrameId last_keyframe() const { return last_keyframe_; }
  MapId last_map() const { return last_map_; }
  bool is_busy() const { return running_ || proposal_ || outbox_ || closing_ || wants_global_ || !ready_.empty(); }

  const std::vector<ClosureRecord>& closures() const { return closures_; }
  const std::deque<LoopRefusal>& refusals() const { return refusals_; }
  struct Counters {
    uint64_t looked_at = 0, passed_over = 0, candidates = 0, consistent = 0, refused = 0, confirmed = 0, closed = 0,
             failed = 0;
    uint64_t global_ba = 0, forward_ba = 0, cancelled = 0;
  };
  const Counters& counters() const { return counters_; }
  /// Milliseconds: words, verify and its steps, the steps of the jobs.
  const StageTimes& stage_times() const { return times_; }

 private:
  struct Ready {
    MapId map;
    KeyFrameId keyframe;
    Revision revision = 0;  // of the map when the mapper was done with it
  };
  struct Running {
    JobKind kind = JobKind::kLoop;
    MapId map;
    Epoch epoch = 0;
  };
  struct Proposal {
    JobKind kind = JobKind::kLoop;
    uint64_t number = 0;
    MapId map;
  };
  struct Owner {
    Epoch epoch = 0;
    bool is_mine = false;  // the robot's mapper
  };

  void LookAt(const Ready& ready);
  void NoteLookedAt(MapId map, KeyFrameId keyframe);
  void NoteRefusals(const Map& map, const std::vector<LoopRefusal>& refusals);
  void OnLoop(const Map& map, const DetectedLoop& loop);
  void OnAnswered(const MapperState& state);
  void FinishClosure(const std::string& problem);
  void OnFused(MapId map, MapId other);
  void DropWork(MapId map, const std::string& reason);
  void NoteOwner(MapId map, Epoch epoch, bool is_mine);
  bool IsMine(MapId map) const;
  bool IsAtHand(MapId map) const;
  bool IsReady(const Ready& ready) const;
  bool Has(MapId map, Revision revision) const;
  bool IsSettled() const;
  Job MakeJob(JobKind kind, MapId map);
  bool IsForwardDue() const;

  LoopOptions options_;
  bool is_active_ = true;
  ProcessId process_;
  MapFollower follower_;
  LoopDetector detector_;
  MapId detector_map_;
  std::map<MapId, Owner> owners_;
  std::deque<Ready> ready_;
  KeyFrameId last_keyframe_;
  MapId last_map_;

  std::optional<DetectedLoop> closing_;  // detected, its correction not in the map yet
  MapId closing_map_;
  std::vector<std::pair<KeyFrameId, KeyFrameId>> closing_edges_;
  std::map<MapId, std::vector<std::pair<KeyFrameId, KeyFrameId>>> loop_edges_;  // of the loops closed here
  Stopwatch since_detection_;
  std::optional<Running> running_;
  std::optional<MapCorrection> outbox_;
  std::optional<Proposal> proposal_;  // published, not answered
  std::optional<JobKind> outbox_kind_;
  MapId corrected_map_;
  Revision corrected_revision_ = 0;    // at which the map has the last correction
  std::optional<MapId> wants_global_;  // after a loop or a fusion, or asked for
  int keyframes_since_forward_ = 0;
  // Times options_.forward_every_keyframes: longer where FBA does not improve on the local BA.
  int forward_patience_ = 1;
  uint64_t next_number_ = 1;

  std::vector<ClosureRecord> closures_;
  std::deque<LoopRefusal> refusals_;  // the last ones
  Counters counters_;
  StageTimes times_;
};

}  // namespace portolan
