#pragma once

#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "atlas/atlas.h"
#include "atlas/map_joiner.h"
#include "atlas/map_saver.h"
#include "atlas/map_shelf.h"
#include "atlas/map_store.h"
#include "atlas/overlap_detector.h"
#include "atlas/succession.h"
#include "base/log.h"
#include "base/statistics.h"
#include "process/atlas_config.h"
#include "process/process_setup.h"
#include "process/snapshot_sender.h"
#include "process/status_publisher.h"
#include "transport/background_work.h"
#include "transport/process_loop.h"
#include "vocabulary/vocabulary.h"

namespace portolan {

/// The shell around the atlas: hears requests and statuses, grants maps, follows every map and stores it, and stands in
/// with snapshots for owners that are dead. Looks each new keyframe up in the other maps, and has maps switched or
/// fused by what it finds. Of what is stored only that is kept in memory which is used (MapShelf): code that needs more
/// of a map than its figures, and may come upon one that is paged, has it brought in. One owner thread,
/// whose work is cut into bounded pieces, and one behind it that makes proposals for fusions. One that stands by behind
/// another hears all of this and says nothing, but follows the other's list of maps and its graph too; with a store of
/// its own it stores them.
class AtlasProcess {
 public:
  /// Opens a store that another process has still.
  using OpenStore = std::function<Result<std::unique_ptr<MapStore>>()>;

  /// @param store may be null: nothing is stored. @param open_later of one that stands by: its store is the other's,
  /// until that one has left; else null.
  AtlasProcess(const ProcessSetup& setup, const AtlasOptions& options, std::shared_ptr<const Vocabulary> vocabulary,
               std::unique_ptr<MapStore> store, OpenStore open_later, Bus* bus, const std::string& priority,
               ProcessLoop* loop);
  ~AtlasProcess();

  /// Takes up what is in the store. Before Run().
  Status LoadStore();
  /// Runs until SIGINT, SIGTERM, or another has its place, stores what is not stored yet and writes its report. @return
  /// exit code.
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

  // Standing by, and leaving the place to one that does (atlas_standby.cc).
  void ConnectStandby();
  void AskForList();
  void OnReply(const Reply& reply);
  void OnCommand(const Command& command);
  void TakeUpList(const std::string& text);
  void TakeUpGraph(const std::string& text);
  void TellHeld();
  void StandByTick();
  bool IsLeftAlone() const;
  void TakePlace();
  void OpenStoreNow();
  void SaveOwnerships();
  void LeaveIfAsked();
  size_t NumMissingMaps() const;
  Revision Lag() const;

  /// After each event: what became possible with it, and what is to be told.
  void Continue();
  void ApplyPending();
  void PublishDecisions();

  // Overlaps (atlas_lookup.cc).
  struct Waiting {
    MapId map;
    KeyFrameId keyframe;
    Revision revision = 0;  ///< of the map when the mapper was done with it
  };
  /// What a user ordered or a lost tracker asked, that takes more than one event.
  struct Search {
    Request request;
    std::deque<KeyFrameId> keyframes;  ///< "fuse": of `other`, still to be looked up in `map`
    std::string reason;                ///< why the last came to nothing
    double since_s = 0;
    bool is_handed_over = false;  ///< "fuse": an overlap was found; answered when the fusion has ended
  };
  void QueueKeyFrame(const MapperState& state);
  bool LookUpNext();
  void LookUp(const Waiting& next, const Map& map, const BowVector& bow);
  void TakeOrders();
  Status Obey(const Request& order);
  void AnswerEndedOrders();
  void ContinueSearches();
  std::optional<Reply> ContinueSearch(Search* search);
  std::optional<Reply> Locate(const Search& search, const KeyFrameData& frame);
  std::optional<Reply> LookForFusion(Search* search);
  void StartFusion();
  bool EnsureAround(const Map& map, KeyFrameId keyframe);
  void OnFused(MapId map, MapId other, Revision revision);
  void TakeUpFusions();
  void PublishFollowers(bool all);

  void SaveGraph();
  void SendSnapshots();
  /// The whole data of a keyframe, from the store where memory has it bare.
  Result<KeyFrameData> WholeData(const KeyFrameData& data);
  Result<KeyFrameData> LoadKeyFrame(KeyFrameId id);
  Result<MapDelta> LoadState(MapId id);
  void TakeInStored(StoredMap stored);
  void TakeIn(StoredMap map, bool is_stored);
  bool MayBePaged(const Map& map) const;
  void Trim();
  void StoreAPiece();
  void DropWhatIsStored();
  void NoteStoreFailure(const Error& error);
  Status SaveAll();
  Reply ListMaps() const;
  Reply DescribeGraph(const std::string& format) const;
  std::map<MapId, MapLabel> LabelMaps() const;
  void AddOverlaps(nlohmann::json* report) const;
  Reply SaveOnRequest();
  Reply ImportMaps(const Request& request);
  int Finish();
  struct Totals {
    size_t maps = 0, keyframes = 0, points = 0;
  };
  Totals CountTotals() const;
  static double Now() { return std::chrono::duration<double>(Clock::now().time_since_epoch()).count(); }

  const ProcessSetup& setup_;
  const uint64_t vocabulary_hash_;
  std::unique_ptr<MapStore> store_;
  OpenStore open_later_;  // null: the store is here, or there is none
  Bus* bus_;
  std::string priority_;
  ProcessLoop* loop_;
  StatusPublisher status_;
  std::unique_ptr<Writer<Command>> command_writer_;
  std::unique_ptr<Writer<Reply>> reply_writer_;
  std::unique_ptr<Writer<KeyFrameMessage>> keyframe_writer_;
  std::unique_ptr<Writer<MapDeltaChunk>> delta_writer_;
  std::unique_ptr<Writer<SnapshotRequest>> snapshot_writer_;
  std::unique_ptr<Writer<MapCorrection>> correction_writer_;
  std::unique_ptr<Writer<FollowerState>> follower_writer_;
  std::vector<std::unique_ptr<Reader>> readers_;
  SnapshotSender snapshots_;
  bool snapshots_go_on_ = false;  // an event for the next piece is posted

  const AtlasOptions options_;
  Atlas atlas_;
  MapShelf shelf_;
  OverlapDetector detector_;
  MapJoiner joiner_;
  Succession succession_;
  std::optional<MapSaver> saver_;
  std::deque<Waiting> waiting_;                             // keyframes to be looked up
  std::map<RobotId, FollowerState> followers_, published_;  // by the robot whose keyframes they are about
  std::map<ProcessId, KeyFrameId> queued_;                  // the last of each mapper
  std::deque<KeyFrameData> queries_;                        // of trackers that know no map
  std::deque<Search> searches_;
  std::map<RequestId, std::string> imports_;    // answered: the maps
  std::optional<FusionTask> fusion_;            // waits for descriptors
  std::vector<MapJoiner::Done> to_be_deleted_;  // maps that were fused, until what they went into is stored
  uint64_t saved_graph_ = 0;                    // version
  std::deque<OverlapRefusal> refusals_;         // the last ones
  struct Lookups {
    uint64_t keyframes = 0, passed_over = 0, maps = 0, candidates = 0, consistent = 0, verified = 0, confirmed = 0,
             refused = 0;
    uint64_t located = 0, not_located = 0;
  } lookups_;
  double lookup_ms_ = 0;  // of the last keyframe
  LogThrottle store_log_;
  MapId last_map_;  // that changed
  // Of one that stands by.
  IdMinter<RequestId> request_ids_;
  std::unique_ptr<Writer<Request>> request_writer_;
  RequestId asked_list_, asked_graph_;
  std::string graph_text_;
  std::map<MapId, std::pair<Epoch, Revision>> told_;
  bool is_telling_ = false;  // the one that has the place drains
  bool has_heard_holder_ = false;
  double awake_since_s_ = 0, last_tick_s_ = 0;
  std::optional<double> taking_place_since_s_;
  bool has_left_ = false;
  std::string store_path_;
  int exit_code_ = kExitOk;
  uint64_t foreign_vocabulary_ = 0, grants_ = 0, snapshots_asked_ = 0, store_failures_ = 0;
  StageTimes times_;
  BackgroundWork background_;
};

}  // namespace portolan
