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
#include "loop/loop_journal.h"
#include "loop/loop_options.h"
#include "loop/map_follower.h"
#include "map/protocol.h"

namespace portolan {

/// Loop closing (paper Sec. 5) of the map that a robot is in: follows it as a replica, looks for loops at each new
/// keyframe, and proposes corrections to the map's owner; in idle times forward sparse BA. Pure: no DDS, no threads;
/// long work is handed out as jobs.
///
///   LoopCloser closer(options, vocabulary, process);
///   closer.follower().AddKeyFrame(message); ...AddChunk(chunk); closer.OnMapperState(state);  // what comes in
///   closer.Update();                                                                           // after each of them
///   if (closer.ShouldCancel()) the job's stop = true;
///   if (auto job = closer.NextJob()) closer.OnJobDone((*job)(stop));                           // or on a thread
///   while (auto correction = closer.TakeCorrection()) publish it;
class LoopCloser {
 public:
  using JobKind = LoopJobKind;
  struct JobResult {
    JobKind kind = JobKind::kLoop;
    MapId map;
    Result<MapCorrection> correction = Error{"not run"};
    StageTimes times;
    std::optional<LossChange> losses;
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
  /// Whether the job under way is not worth ending: its map has another owner, is no more or was corrected meanwhile, a
  /// loop was found, or the place is to pass on.
  bool ShouldCancel() const;
  /// The job under way came back, or (null) was cancelled.
  void OnJobDone(JobResult result);
  void OnJobCancelled();
  /// What is to be published, once.
  std::optional<MapCorrection> TakeCorrection();

  /// Nobody answered for a correction that was published: the owner is gone, or hangs. What it says after all still
  /// counts.
  void ForgetCorrection(const std::string& reason);
  bool AwaitsAnswer() const { return proposal_.has_value(); }
  /// The run is over: what is under way comes to nothing.
  void End();

  /// For lockstep: the last keyframe looked at (or passed over), the map it came in, and whether something of it is
  /// still under way.
  KeyFrameId last_keyframe() const { return last_keyframe_; }
  MapId last_map() const { return last_map_; }
  bool is_busy() const { return running_ || proposal_ || outbox_ || closing_ || wants_global_ || !ready_.empty(); }

  const LoopJournal& journal() const { return journal_; }
  const std::vector<ClosureRecord>& closures() const { return journal_.closures(); }
  const LoopCounters& counters() const { return journal_.counters(); }
  /// Milliseconds: words, verify and its steps, the steps of the jobs.
  const StageTimes& stage_times() const { return times_; }

 private:
  struct Ready {
    MapId map;
    KeyFrameId keyframe;
    Epoch epoch = 0;  // of the map when the mapper was done with it
    Revision revision = 0;
  };
  // A loop, from its detection to the answer.
  struct Closing {
    DetectedLoop loop;
    MapId map;
    size_t record = 0;  // of the journal
    Stopwatch since_detection;
    std::vector<std::pair<KeyFrameId, KeyFrameId>> edges;  // once they are known
  };
  struct Running {
    JobKind kind = JobKind::kLoop;
    MapId map;
    Epoch epoch = 0;  // of the snapshot
    Revision revision = 0;
  };
  struct Proposal {
    JobKind kind = JobKind::kLoop;
    uint64_t number = 0;
    MapId map;
    Epoch epoch = 0;
    std::optional<Closing> forgotten_loop;  // kLoop, once nobody had answered
  };
  struct Owner {
    Epoch epoch = 0;
    bool is_mine = false;  // the robot's mapper
  };

  void LookAt(const Ready& ready);
  void NoteLookedAt(MapId map, KeyFrameId keyframe);
  void KeepTimes(const StageTimes& times);
  void OnAnswered(const MapperState& state);
  void OnLateAnswer(const Proposal& proposal, const MapperState& state);
  void OnApplied(const Proposal& proposal);
  void NoteCorrected(const MapperState& state);
  void TryGlobalAgain(MapId map);
  void FinishClosure(const std::string& problem);
  void EndClosure(const Closing& closing, const std::string& problem);
  void OnFused(MapId map, MapId other);
  void DropWork(MapId map, const std::string& reason);
  void NoteOwner(MapId map, Epoch epoch, bool is_mine);
  bool IsMine(MapId map) const;
  bool IsAtHand(MapId map) const;
  bool IsReady(const Ready& ready) const;
  bool Has(MapId map, Epoch epoch, Revision revision) const;
  bool IsSettled() const;
  bool IsOutdated(const Running& running) const;
  Job MakeJob(JobKind kind, MapId map);
  bool IsForwardDue() const;
  KeyFrameId ForwardStart() const;

  LoopOptions options_;
  bool is_active_ = true;
  ProcessId process_;
  MapFollower follower_;
  LoopDetector detector_;
  MapId detector_map_;
  KeyFrameId detector_keyframe_;  // the last that it looked at, in that map
  std::map<MapId, Owner> owners_;
  std::deque<Ready> ready_;
  KeyFrameId last_keyframe_;
  MapId last_map_;

  std::optional<Closing> closing_;  // detected, its correction not in the map yet
  std::map<MapId, std::vector<std::pair<KeyFrameId, KeyFrameId>>> loop_edges_;  // of the loops closed here
  std::optional<Running> running_;
  std::optional<MapCorrection> outbox_;
  std::optional<JobKind> outbox_kind_;
  std::optional<Proposal> proposal_;  // published, not answered
  std::deque<Proposal> forgotten_;    // not answered in time; the last ones
  // Where the owner was when it answered last: what is made next is made from there, or later.
  MapId corrected_map_;
  Epoch corrected_epoch_ = 0;
  Revision corrected_revision_ = 0;
  std::optional<MapId> wants_global_;  // after a loop or a fusion, or asked for
  int global_refusals_ = 0;            // in a row
  int keyframes_since_forward_ = 0;
  int keyframes_before_forward_ = 0;  // that made the last one due
  // Times options_.forward_every_keyframes: longer where FBA does not improve on the local BA.
  int forward_patience_ = 1;
  uint64_t next_number_ = 1;

  LoopJournal journal_;
  StageTimes times_;
};

}  // namespace portolan
