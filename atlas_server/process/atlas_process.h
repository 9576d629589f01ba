#pragma once

#include <memory>
#include <string>
#include <vector>

#include "atlas/atlas.h"
#include "atlas/map_saver.h"
#include "atlas/map_store.h"
#include "base/log.h"
#include "base/statistics.h"
#include "map/replica_set.h"
#include "process/atlas_config.h"
#include "process/process_setup.h"
#include "process/status_publisher.h"
#include "transport/process_loop.h"
#include "vocabulary/vocabulary.h"

namespace portolan {

/// The shell around the atlas: hears requests and statuses, grants maps, follows every map and stores it, and stands in
/// with snapshots for owners that are dead. Descriptors that are stored are not kept in memory. One owner thread; the
/// store's work on it is cut into bounded pieces.
class AtlasProcess {
 public:
  /// @param store may be null: nothing is stored.
  AtlasProcess(const ProcessSetup& setup, const AtlasOptions& options, uint64_t vocabulary_hash, MapStore* store,
               Bus* bus, const std::string& priority, ProcessLoop* loop);
  ~AtlasProcess();

  /// Takes up what is in the store. Before Run().
  Status LoadStore();
  /// Runs until SIGINT or SIGTERM, stores what is not stored yet and writes its report. @return exit code.
  int Run();

 private:
  using Clock = std::chrono::steady_clock;

  void ConnectReaders();
  void OnKeyFrame(const KeyFrameMessage& message);
  void OnDeltaChunk(const MapDeltaChunk& chunk);
  void OnRequest(const Request& request);
  void OnStatus(const ProcessStatus& status);
  void OnMapperState(const MapperState& state);
  void OnSnapshotRequest(const SnapshotRequest& request);
  void OnTick();
  void OnStatusTimer();

  void ApplyPending();
  void PublishDecisions();
  void SendSnapshot(const Map& map, const std::vector<KeyFrameId>& have);
  /// The whole data of a keyframe, from the store where memory has it bare.
  Result<KeyFrameData> WholeData(const KeyFrameData& data);
  void StoreAPiece();
  void DropWhatIsStored();
  void NoteStoreFailure(const Error& error);
  Status SaveAll();
  Reply ListMaps() const;
  Reply SaveOnRequest();
  int Finish();
  struct Totals {
    size_t maps = 0, keyframes = 0, points = 0;
  };
  Totals CountTotals() const;
  static double Now() { return std::chrono::duration<double>(Clock::now().time_since_epoch()).count(); }

  const ProcessSetup& setup_;
  const uint64_t vocabulary_hash_;
  MapStore* store_;
  Bus* bus_;
  std::string priority_;
  ProcessLoop* loop_;
  StatusPublisher status_;
  std::unique_ptr<Writer<Command>> command_writer_;
  std::unique_ptr<Writer<Reply>> reply_writer_;
  std::unique_ptr<Writer<KeyFrameMessage>> keyframe_writer_;
  std::unique_ptr<Writer<MapDeltaChunk>> delta_writer_;
  std::unique_ptr<Writer<SnapshotRequest>> snapshot_writer_;
  std::vector<std::unique_ptr<Reader>> readers_;

  Atlas atlas_;
  ReplicaSet replicas_;
  std::optional<MapSaver> saver_;
  LogThrottle store_log_;
  MapId last_map_;  // that changed
  uint64_t foreign_vocabulary_ = 0, grants_ = 0, snapshots_sent_ = 0, snapshots_asked_ = 0, store_failures_ = 0;
  StageTimes times_;
};

}  // namespace portolan
