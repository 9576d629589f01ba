#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/statistics.h"
#include "loop/loop_closer.h"
#include "map/held_map.h"
#include "process/process_setup.h"
#include "process/status_publisher.h"
#include "transport/background_work.h"
#include "transport/process_loop.h"

namespace portolan {

/// The shell around loop closing: follows the maps and looks for loops on one owner thread, corrects them on a second
/// behind it. One that stands by follows and no more, until the atlas_server appoints it: of a robot's loop_closers one
/// proposes.
class LoopProcess {
 public:
  LoopProcess(const ProcessSetup& setup, const LoopOptions& options, std::shared_ptr<const Vocabulary> vocabulary,
              Bus* bus, const std::string& priority, ProcessLoop* loop);
  ~LoopProcess();

  /// Runs until SIGINT, SIGTERM, or another has its place, then writes its report. @return exit code.
  int Run();

 private:
  using Clock = std::chrono::steady_clock;

  void ConnectReaders();
  void OnKeyFrame(const KeyFrameMessage& message);
  void OnDeltaChunk(const MapDeltaChunk& chunk);
  void OnMapperState(const MapperState& state);
  void OnStatus(const ProcessStatus& status);
  void OnTrackerState(const TrackerState& state);
  void OnCommand(const Command& command);
  void OnTick();
  void OnStatusTimer();
  void OnLogTimer();
  void Continue();
  void StartJob(LoopCloser::Job job);
  void PublishState();
  // Standing by, and leaving the place to one that does (loop_standby.cc).
  void OnDrain(ProcessId process);
  void OnAppointment(ProcessId process);
  void ContinueDrain(bool all);
  void TellHeld();
  void Report(const std::string& kind, MapId map, const std::string& argument);
  std::string StateInWords(bool has_map) const;

  int Finish();

  const ProcessSetup& setup_;
  Bus* bus_;
  std::string priority_;
  ProcessLoop* loop_;
  StatusPublisher status_;
  std::unique_ptr<Writer<SnapshotRequest>> snapshot_writer_;
  std::unique_ptr<Writer<MapCorrection>> correction_writer_;
  std::unique_ptr<Writer<FollowerState>> state_writer_;
  std::unique_ptr<Writer<Request>> request_writer_;
  std::vector<std::unique_ptr<Reader>> readers_;

  LoopCloser closer_;
  FollowerState state_;  // as last published
  IdMinter<RequestId> request_ids_;
  bool is_standby_;
  ProcessId draining_;  // a loop_closer, this one or another; none: nobody is
  std::optional<Clock::time_point> drained_since_;
  HeldMap told_;  // last, of the active map
  Clock::time_point proposed_at_{};
  Revision logged_revision_ = 0;
  MapId logged_map_;
  uint64_t foreign_ = 0, snapshots_asked_ = 0;
  StageTimes times_;
  BackgroundWork background_;
};

}  // namespace portolan
