#pragma once

#include <memory>
#include <string>
#include <vector>

#include "base/statistics.h"
#include "loop/loop_closer.h"
#include "process/process_setup.h"
#include "process/status_publisher.h"
#include "transport/background_work.h"
#include "transport/process_loop.h"

namespace portolan {

/// The shell around loop closing: follows the maps and looks for loops on one owner thread, corrects them on a second behind it.
class LoopProcess {
 public:
  LoopProcess(const ProcessSetup& setup, const LoopOptions& options, std::shared_ptr<const Vocabulary> vocabulary, Bus* bus,
              const std::string& priority, ProcessLoop* loop);
  ~LoopProcess();

  /// Runs until SIGINT or SIGTERM, then writes its report. @return exit code.
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
  int Finish();

  const ProcessSetup& setup_;
  Bus* bus_;
  std::string priority_;
  ProcessLoop* loop_;
  StatusPublisher status_;
  std::unique_ptr<Writer<SnapshotRequest>> snapshot_writer_;
  std::unique_ptr<Writer<MapCorrection>> correction_writer_;
  std::unique_ptr<Writer<FollowerState>> state_writer_;
  std::vector<std::unique_ptr<Reader>> readers_;

  LoopCloser closer_;
  FollowerState state_;                 // as last published
  Clock::time_point proposed_at_{};
  Revision logged_revision_ = 0;
  MapId logged_map_;
  uint64_t foreign_ = 0, snapshots_asked_ = 0;
  StageTimes times_;
  BackgroundWork background_;
};

}  // namespace portolan
