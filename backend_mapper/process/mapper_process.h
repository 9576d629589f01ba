#pragma once

#include <atomic>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "map/map_replica.h"
#include "mapping/fused_maps.h"
#include "mapping/known_residuals.h"
#include "mapping/local_mapper.h"
#include "mapping/passed_on_maps.h"
#include "mapping/warm_maps.h"
#include "process/process_setup.h"
#include "process/snapshot_sender.h"
#include "process/status_publisher.h"
#include "transport/background_work.h"
#include "transport/process_loop.h"

namespace portolan {

/// The shell around the mapper: owns the maps that the atlas_server grants it, takes in keyframes, publishes deltas and
/// answers snapshot requests, all on one owner thread. The tracker's interrupt comes in beside it and stops an
/// optimisation under way. Robots may share a partition: what concerns maps of others is passed over. One that stands
/// by follows another's maps, and owns them when that one leaves its place or dies.
class MapperProcess {
 public:
  MapperProcess(const ProcessSetup& setup, const MapperOptions& options, uint64_t vocabulary_hash, Bus* bus,
                const std::string& priority, ProcessLoop* loop);
  ~MapperProcess();

  /// Runs until SIGINT, SIGTERM, or the atlas_server refuses it or has given its place to another. Writes its report.
  /// @return exit code.
  int Run();

 private:
  using Clock = std::chrono::steady_clock;

  void ConnectReaders();
  void OnKeyFrame(KeyFrameMessage message);
  void OnCopy(const KeyFrameMessage& copy);
  void OnCommand(const Command& command);
  void OnSnapshotRequest(const SnapshotRequest& request);
  void SendSnapshots();
  void OnReply(const Reply& reply);
  void OnDeltaChunk(const MapDeltaChunk& chunk);
  void OnCorrection(const MapCorrection& correction);
  void OnTick();
  void OnStatusTimer();

  // Standing by, and leaving the place to one that does (mapper_standby.cc).
  void FollowOwner();
  void TellHeld(const HeldMap& held);
  void OnDrain(ProcessId process);
  void ContinueDrain();
  void TellAllHeld();
  void OnAppointment(ProcessId process);
  bool IsDrained() const { return drained_since_.has_value(); }
  std::string StateInWords() const;
  size_t NumKeyFrames() const;

  // Which maps are this process's (mapper_maps.cc).
  void Own(MapId map, Epoch epoch);
  void PassOn(MapId map, Epoch epoch);
  void Forget(MapId map);
  void Drop(MapId map);
  static void KeepTimes(const LocalMapper& mapper, StageTimes* times);
  void WaitForGrant(KeyFrameMessage message);
  void TakeEarly();
  std::unique_ptr<LocalMapper> MakeMapper(Map map, Epoch epoch);
  Status Fuse(const MapCorrection& fusion);
  struct Takeover;
  void ContinueTakeovers();
  bool ContinueTakeover(Takeover* takeover);
  void Take(LocalMapper* mapper, const KeyFrameMessage& message);
  Status TakeIntoMap(LocalMapper* mapper, std::shared_ptr<const KeyFrameData> data, const KeyFrameMessage& message);
  void RefineLens(MapId map, LocalMapper* mapper);
  void OnLensFinding(MapId map, Epoch epoch, const PinholeCamera& camera, const LensFinding& finding);
  void AdaptMap(const Map& map, const CameraResidual& known);
  void OnAdapted(const CameraResidual& known, const MapCorrection& adaptation);
  void AdaptMaps();
  void PublishDelta(const MapDelta& delta);
  void PublishState(bool idle);
  void TellIdle();
  bool Concerns(RobotId robot, MapId map) const;
  void Register();

  const ProcessSetup& setup_;
  MapperOptions options_;
  const uint64_t vocabulary_hash_;
  Bus* bus_;
  std::string priority_;
  ProcessLoop* loop_;
  StatusPublisher status_;
  std::unique_ptr<Writer<MapDeltaChunk>> delta_writer_;
  std::unique_ptr<Writer<KeyFrameMessage>> keyframe_writer_;
  std::unique_ptr<Writer<MapperState>> state_writer_;
  std::unique_ptr<Writer<Request>> request_writer_;
  std::unique_ptr<Writer<SnapshotRequest>> snapshot_writer_;
  std::vector<std::unique_ptr<Reader>> readers_;
  SnapshotSender snapshots_;
  bool snapshots_go_on_ = false;  // an event for the next piece is posted

  std::map<MapId, std::unique_ptr<LocalMapper>> mappers_;
  /// A map granted with a history: followed until a snapshot brings it up to its last owner's state.
  struct Takeover {
    MapReplica replica;
    Epoch epoch = 0;
    Clock::time_point last_request{};
    /// The atlas_server may have more of it than was followed here: not without its answer, if one comes in time.
    bool is_open = false;
    Clock::time_point since{};
  };
  std::map<MapId, Takeover> takeovers_;
  PassedOnMaps passed_on_;
  FusedMaps fused_;
  IdMinter<MapPointId> point_ids_;
  DeltaAssembler assembler_;
  std::map<KeyFrameId, std::shared_ptr<const KeyFrameData>> firsts_;  // first frames of pairs
  // For maps granted soon or being taken over, bounded.
  std::vector<KeyFrameMessage> early_;
  std::atomic<int> keyframes_waiting_{0};
  std::atomic<bool> stop_optimisation_{false};
  MapperState state_;
  KnownResiduals residuals_;
  IdMinter<RequestId> request_ids_;
  std::optional<Request> registration_;  // until it is answered
  bool is_standby_;
  WarmMaps warm_maps_;                              // of the mapper behind which it stands by
  ProcessId draining_;                              // this process, or that mapper; none: nobody is
  std::optional<Clock::time_point> drained_since_;  // this process
  uint64_t taken_ = 0, refused_ = 0, repeated_ = 0, interrupts_ = 0, foreign_vocabulary_ = 0, early_dropped_ = 0,
           corrections_ = 0, fusions_ = 0;
  StageTimes process_times_;
  int exit_code_ = kExitOk;
  BackgroundWork background_;
};

}  // namespace portolan
