#pragma once

#include <chrono>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <string>

#include "process/frame_pump.h"
#include "process/frontend_options.h"
#include "process/open_requests.h"
#include "process/process_setup.h"
#include "process/run_so_far.h"
#include "process/status_publisher.h"
#include "tracking/follower_watch.h"
#include "tracking/joined_trajectory.h"
#include "tracking/keyframe_resend.h"
#include "tracking/tracker.h"
#include "transport/process_loop.h"

namespace portolan {

/// The shell around the tracker: frames from a player, deltas and states from DDS, one owner thread for all of it
/// (ProcessLoop).
class FrontendProcess {
 public:
  FrontendProcess(const ProcessSetup& setup, const FrontendOptions& options, std::unique_ptr<Player> player,
                  RunSoFar so_far, std::shared_ptr<const Vocabulary> vocabulary, Bus* bus, const std::string& priority,
                  ProcessLoop* loop);
  ~FrontendProcess();

  /// Runs until the source has ended and the mapper has taken in the last keyframe, or the user stops it. Writes the
  /// results.
  /// @return exit code.
  int Run();

 private:
  using Clock = std::chrono::steady_clock;
  enum class Phase { kWaitingForPeers, kAskingAtlas, kRunning, kDraining, kOver };

  void ConnectReaders();
  void CheckPeers();
  void AskAtlas();
  void StartWhenAnswered();
  void OnFrame(PlayedFrame frame);
  void OnCommand(const Command& command);
  bool TakesOrders() const { return phase_ == Phase::kRunning; }
  void OnReply(const Reply& reply);
  void OnMapper(const MapperState& state);
  void OnDeltaChunk(MapDeltaChunk chunk);
  void OnEndOfSource();
  void OnTick();  // ten times a second: what waits for an answer that may not come
  void OnStatusTimer();
  void Publish(const Tracker::Output& output);
  void SendAgain();
  void AskForSnapshots();
  void NoteFollowedMaps();
  void ReleasePumpIfReady();
  bool OthersAreDone() const;
  bool HasRoomForOthers(MapId map) const;
  bool MapperIsDone() const;
  bool IsWaitingForAtlas() const;
  bool IsWaitingForEarlierMaps() const;
  std::string StateInWords() const;
  void AddMapsTo(nlohmann::json* report, const RunTrajectories& trajectories) const;
  void ShowProgress(const TrackerState& state);
  int Finish();

  const ProcessSetup& setup_;
  const FrontendOptions& options_;
  Bus* bus_;
  ProcessLoop* loop_;
  std::unique_ptr<Player> player_;
  RunSoFar so_far_;
  std::shared_ptr<const Vocabulary> vocabulary_;
  std::string priority_;
  Tracker tracker_;
  FramePump pump_;
  StatusPublisher status_;

  std::unique_ptr<Writer<KeyFrameMessage>> keyframe_writer_;
  std::unique_ptr<Writer<TrackerState>> state_writer_;
  std::unique_ptr<Writer<SnapshotRequest>> snapshot_writer_;
  std::vector<std::unique_ptr<Reader>> readers_;

  Phase phase_ = Phase::kWaitingForPeers;
  Clock::time_point phase_start_ = Clock::now();
  std::set<std::string> roles_seen_;
  DeltaAssembler assembler_;
  MapperState mapper_;
  FollowerWatch followers_;
  bool loop_closer_is_ready_ = false;
  bool frame_in_work_ = false;
  bool paused_ = false;
  OpenRequests requests_;
  // Read by transport threads, by std::atomic_load.
  std::shared_ptr<const std::set<MapId>> followed_ = std::make_shared<const std::set<MapId>>();
  Clock::time_point last_send_ = Clock::now();  // of a keyframe, for the first time
  KeyFrameResend resend_;
  Clock::time_point last_snapshot_request_{};
  Clock::time_point last_progress_{};
  std::optional<Clock::time_point> in_need_since_;
  std::map<KeyFrameId, Clock::time_point> published_;  // to measure a keyframe's way to the replica
  StageTimes process_times_;
  uint64_t frames_ = 0, tracked_online_ = 0, sent_again_ = 0;
  TrackerState last_state_;
  MapId reported_map_;
  int exit_code_ = kExitOk;
};

}  // namespace portolan
